"""A building of EnergyPlus behind the BMS: it lives, has faults and obeys the plant's side."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import numpy as np
import pytest
from support.bms_plant import Clock, ask, served, simulation
from support.energyplus import needs_energyplus

from estimator.network.assembly import assemble
from replay.bms.energyplus.building import PlantRooms
from replay.bms.energyplus.world import EnergyPlusWorld
from replay.bms.simulation import Simulation
from replay.bms.written_config import configuration, over_modbus
from replay.energyplus.buildings import BUILDINGS
from replay.energyplus.plant import STEP

HOUR = 3600.0


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def plant(clock: Clock) -> Iterator[Simulation]:
    world = EnergyPlusWorld("house", "denver", 1)
    yield simulation(clock, living=world, pace=60.0)
    world.close()


def pass_hours(plant: Simulation, clock: Clock, hours: float) -> None:
    clock.now += hours * HOUR / plant.pace
    assert plant.catch_up() == 0


@needs_energyplus
def test_it_lives_by_the_clock_and_shows_what_acts(plant: Simulation, clock: Clock) -> None:
    assert plant.world.elapsed == 0
    clock.now += 1.5 * STEP / plant.pace
    plant.catch_up()
    assert plant.world.elapsed == STEP
    shown = plant.world.now.power
    pass_hours(plant, clock, STEP / HOUR)
    now = plant.world.now
    np.testing.assert_allclose(now.flows["heating"], shown)
    assert now.gain == pytest.approx(
        sum(now.flows[name] for name in ("people", "equipment", "lights", "windows", "sun"))
    )
    pass_hours(plant, clock, 18)
    evening = plant.world.now
    assert np.abs(evening.air - evening.set_point).max() < 3.0
    assert evening.energy.min() > 0


@needs_energyplus
def test_its_sensors_are_read_over_modbus(plant: Simulation) -> None:
    async def read() -> tuple[float, float, float]:
        async with served(plant) as client:
            air = (await client.read_holding_registers(100, count=2, device_id=12)).registers
            power = (await client.read_holding_registers(102, count=2, device_id=11)).registers
            valve = (await client.read_holding_registers(106, count=1, device_id=11)).registers
            floats = client.DATATYPE.FLOAT32
            return (
                client.convert_from_registers(air, floats, word_order="little"),
                client.convert_from_registers(power, floats, word_order="little"),
                valve[0] / 10,
            )

    air, power, valve = asyncio.run(read())
    now = plant.world.now
    assert air == pytest.approx(now.air[1] + now.noise[1], abs=1e-3)
    assert power == pytest.approx(now.power[0] / 1000, abs=1e-5)
    assert valve == pytest.approx(100 * now.power[0] / 4000, abs=0.1)


@needs_energyplus
def test_a_window_left_open_cools_its_room(clock: Clock) -> None:
    found = []
    for window in (False, True):
        world = EnergyPlusWorld("house", "denver", 1)
        other_clock = Clock()
        plant = simulation(other_clock, living=world)
        if window:
            ask(plant, ("POST", "/faults", {"kind": "window", "device": "upper", "value": 100}))
        pass_hours(plant, other_clock, 2)
        found.append(world.now)
        world.close()
    shut, opened = found
    assert opened.opening[1] == 100
    assert opened.flows["windows"][1] < -1000
    assert opened.air[1] < shut.air[1] - 0.3
    assert opened.power[1] > shut.power[1] + 500, "the panel heats against it"


@needs_energyplus
def test_the_state_tells_what_energyplus_knows(plant: Simulation, clock: Clock) -> None:
    (before,) = ask(plant, ("GET", "/state", None))
    assert before.json()["rooms"]["ground"]["flows"] == {}, "nothing has flowed yet"
    pass_hours(plant, clock, 1)
    (state,) = ask(plant, ("GET", "/state", None))
    ground = state.json()["rooms"]["ground"]
    assert ground["T_heater"] is None
    assert ground["T_env"] == pytest.approx(plant.world.now.envelope[0])
    assert ground["parameters"] == {}
    assert ground["flows"]["equipment"] >= 60.0
    assert ground["flows"]["infiltration"] < 0
    assert state.json()["simulated_time"] == "2025-01-13T08:00:00Z"


@needs_energyplus
def test_the_plants_side_sets_heating_and_set_points(plant: Simulation, clock: Clock) -> None:
    put, got, wrong = ask(
        plant,
        ("PUT", "/rooms/ground", {"u_heat": 2500}),
        ("GET", "/rooms/ground", None),
        ("PUT", "/rooms/ground", {"u_heat": 5000}),
    )
    assert (put.status_code, put.json()) == (200, {"set_point": None, "u_heat": 2500.0})
    assert got.json() == put.json()
    assert wrong.status_code == 422
    assert wrong.json()["detail"] == "u_heat: the heater of ground cannot give 5000 W; it gives 0 to 4000 W"
    pass_hours(plant, clock, 1)
    assert plant.world.now.power[0] == 2500
    assert plant.world.now.flows["heating"][0] == 2500
    assert plant.world.now.power[1] != 2500
    ask(plant, ("PUT", "/rooms/ground", {"set_point": 24.0}))
    pass_hours(plant, clock, 6)
    assert plant.world.now.set_point[0] == 24.0
    assert plant.world.now.air[0] > 22.5
    (left,) = ask(plant, ("DELETE", "/rooms/ground", None))
    assert left.status_code == 204
    pass_hours(plant, clock, STEP / HOUR)
    assert plant.world.now.set_point[0] in (17.5, 20.5)
    assert plant.world.now.power[0] == 0.0, "the room is far too warm for its thermostat"


def test_rooms_in_a_row_obey_too(clock: Clock) -> None:
    plant = simulation(clock)
    relay, half, valve, unknown, odd, empty = ask(
        plant,
        ("PUT", "/rooms/room1", {"u_heat": 1500}),
        ("PUT", "/rooms/room1", {"u_heat": 700}),
        ("PUT", "/rooms/room2", {"u_heat": 700, "set_point": 23}),
        ("PUT", "/rooms/attic", {"u_heat": 0}),
        ("PUT", "/rooms/room2", {"power": 5}),
        ("PUT", "/rooms/room3", {"set_point": 99}),
    )
    assert (relay.status_code, valve.status_code) == (200, 200)
    assert half.json()["detail"] == "u_heat: the heater of room1 cannot give 700 W; a relay gives 0 or 1500 W"
    assert unknown.json()["detail"] == 'there is no room "attic"; the rooms are room1, room2, room3'
    assert (odd.status_code, empty.status_code) == (422, 422)
    clock.now += 60
    plant.catch_up()
    assert plant.world.now.power[:2].tolist() == [1500.0, 700.0]
    assert plant.world.now.set_point[1] == 23.0
    ask(plant, ("DELETE", "/rooms/room2", None))
    clock.now += 1
    plant.catch_up()
    assert plant.world.now.set_point[1] < 22.0


@pytest.mark.parametrize("pace", [1.0, 600.0])
def test_the_boxes_of_the_written_networks_follow_from_floor_area_and_pace(pace: float) -> None:
    for building in BUILDINGS.values():
        rooms = PlantRooms(building)
        for index, room in enumerate(building.rooms):
            network = rooms.zone_network(index, pace)
            assert {f"T_{building.rooms[other].name}" for other in building.neighbours(index)} == set(
                network.boundaries[1:]
            )
            assert network.parameter("C_air").lower == pytest.approx(3e3 * room.floor_area / pace, rel=0.05)
            assert network.parameter("g_air_out").upper == pytest.approx(5.0 * room.floor_area, rel=0.05)
            middle = np.array([[np.sqrt(p.lower * p.upper)] for p in network.parameters])
            assert np.all(assemble(network, middle).capacitance > 0)


@needs_energyplus
def test_the_written_configuration_reads_its_rooms(plant: Simulation) -> None:
    written = configuration(plant, over_modbus(5020))
    assert [zone["id"] for zone in written["zones"]] == ["ground", "upper"]
    assert [*written["zones"][0]["channels"]] == ["T_air", "T_out", "T_upper", "u_heat", "I_sol"]
    assert written["zones"][0]["channels"]["T_upper"]["source"] == "upper"
