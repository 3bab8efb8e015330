"""The configuration that reads the building: it is right, exact at any pace, and has the truth within its bounds."""

from pathlib import Path

import numpy as np
import pytest
from support.bms_plant import Clock, simulation

from estimator.particle.options import resolve
from replay.bms.written_config import configuration, write_config, zone_period
from replay.simulated.simulate import dynamics
from service.config.load import load
from service.errors import ConfigError

PACES = [0.5, 1.0, 60.0, 77.0, 600.0, 3600.0]


@pytest.mark.parametrize("pace", PACES)
def test_what_is_written_is_what_the_daemon_reads(pace: float, tmp_path: Path) -> None:
    plant = simulation(Clock(), pace=pace)
    path = tmp_path / "made" / "bms.toml"
    write_config(path, plant, 5020)
    config = load(path)
    assert [zone.id for zone in config.zones] == ["room1", "room2", "room3"]
    assert [*config.sources] == ["weather", "room1", "room2", "room3"]
    assert f"Its pace is {pace:g}:" in path.read_text(encoding="utf-8")
    for index, zone in enumerate(config.zones):
        network, room = zone.network, plant.building.rooms[index]
        for name, value in room.theta.items():
            parameter = network.parameter(name)
            assert parameter.lower < (value / pace if name.startswith("C_") else value) < parameter.upper
        # Noise per step belongs to the simulated length of a step.
        simulated = resolve(network, zone.period * pace, {})
        for option in ("process_sd", "shrinkage"):
            assert zone.estimator_options[option] == pytest.approx(getattr(simulated, option))


def test_periods_divide_a_day_and_are_ten_simulated_minutes_where_seconds_allow() -> None:
    assert [zone_period(pace) for pace in PACES] == [1200, 600, 10, 6, 1, 1]


def test_a_building_with_a_paceth_of_the_capacitance_does_in_real_time_what_the_simulated_one_does_in_its_own() -> None:
    plant, pace = simulation(Clock()), 60.0
    room = plant.building.rooms[1]
    own, seen = (plant.building.zone_network(1, p) for p in (1.0, pace))
    partitions = {"g_room1": 25.0, "g_room3": 30.0}
    slow = dynamics(own, room.theta | partitions, 600.0)
    lighter = {name: value / pace if name.startswith("C_") else value for name, value in room.theta.items()}
    fast = dynamics(seen, lighter | partitions, 600.0 / pace)
    np.testing.assert_allclose(fast.transition, slow.transition, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(fast.input, slow.input, rtol=1e-9, atol=1e-12)


def test_a_relay_reads_as_the_power_behind_it_and_a_neighbour_as_a_boundary() -> None:
    first, second, _ = configuration(simulation(Clock()), 5020)["zones"]
    place = {"source": "room1", "table": "coil", "register": 0, "type": "bool"}
    assert first["channels"]["u_heat"] == place | {"scale": 1500.0, "unit": "W", "aggregate": "mean"}
    assert [*second["channels"]] == ["T_air", "T_out", "T_room1", "T_room3", "u_heat", "I_sol"]
    assert [second["channels"]["T_room3"][key] for key in ("source", "unit")] == ["room3", "K"]


def test_changes_from_the_command_line_are_written(tmp_path: Path) -> None:
    plant, path = simulation(Clock()), tmp_path / "bms.toml"
    write_config(path, plant, 5020, ["http.port=0", "zones.room2.estimator_options.particles=100"])
    config = load(path)
    assert config.http.port == 0
    assert config.zones[1].estimator_options["particles"] == 100
    with pytest.raises(ConfigError, match=r"--set zones\.attic"):
        write_config(path, plant, 5020, ["zones.attic.period=1min"])
