"""The simulated building: its physics against an independent solution, its thermostats, and that a seed is enough."""

import numpy as np
from scipy.integrate import solve_ivp

from replay.bms.living.building import NODES, Building, design
from replay.bms.living.calendar import FIRST_MIDNIGHT, Calendar
from replay.bms.living.thermostats import PiValve
from replay.bms.living.world import BEGIN, STEP, Snapshot, World
from replay.localtime import DAY, HOUR


def lived(world: World, hours: float) -> list[Snapshot]:
    shut = np.zeros(len(world.now.air))
    snapshots = []
    for _ in range(int(hours * HOUR / STEP)):
        world.step(shut)
        snapshots.append(world.now)
    return snapshots


def rates(building: Building, state: np.ndarray, snapshot: Snapshot) -> np.ndarray:
    """dT/dt of every node, K/s, from the heat balances written out by hand."""
    air, envelope, heater = state.reshape(-1, len(NODES)).T
    flows = np.zeros((len(building.rooms), len(NODES)))
    for k, room in enumerate(building.rooms):
        theta = room.theta
        into_wall = theta["g_air_env"] * (air[k] - envelope[k])
        from_heater = theta["g_air_heater"] * (heater[k] - air[k])
        beside = sum(g * (air[other] - air[k]) for other, g in building.neighbours(k).items())
        flows[k] = (
            (snapshot.gain[k] - into_wall + from_heater + beside) / theta["C_air"],
            (into_wall - theta["g_env_out"] * (envelope[k] - snapshot.outdoor)) / theta["C_env"],
            (snapshot.power[k] - from_heater) / theta["C_heater"],
        )
    return flows.ravel()


def stacked(snapshot: Snapshot) -> np.ndarray:
    return np.column_stack([snapshot.air, snapshot.envelope, snapshot.heater]).ravel()


def test_a_step_is_the_solution_of_the_heat_balances() -> None:
    building = design(3, 7)
    world = World(building, 7)
    lived(world, 2)
    for _ in range(20):
        before = world.now
        world.step(np.array([0.0, 50.0, 0.0]))
        solution = solve_ivp(
            lambda _, state, held=before: rates(building, state, held),
            (0.0, STEP),
            stacked(before),
            rtol=1e-10,
            atol=1e-10,
        )
        # Five standard deviations of the process noise of a step.
        np.testing.assert_allclose(stacked(world.now), solution.y[:, -1], atol=0.0025)


def test_the_same_seed_lives_the_same_life_and_another_does_not() -> None:
    first, second, other = (lived(World(design(2, seed), seed), 12)[-1] for seed in (3, 3, 4))
    np.testing.assert_array_equal(stacked(first), stacked(second))
    np.testing.assert_array_equal(first.noise, second.noise)
    assert np.abs(stacked(first) - stacked(other)).max() > 0.1


def test_thermostats_hold_the_set_point_by_day_and_lower_it_by_night() -> None:
    snapshots = lived(World(design(4, 1), 1), 24 - BEGIN / HOUR)
    hours = np.array([(snapshot.time - FIRST_MIDNIGHT) / HOUR for snapshot in snapshots])
    excess = np.array([snapshot.air - snapshot.set_point for snapshot in snapshots])
    afternoon = excess[(hours > 10) & (hours < 19)]
    assert np.abs(afternoon.mean(axis=0)).max() < 0.5
    assert afternoon.min() > -1.5
    assert snapshots[-1].air.mean() < snapshots[0].air.mean() - 1


def test_energy_is_power_over_time() -> None:
    world = World(design(2, 1), 1)
    powers = [world.now.power, *(snapshot.power for snapshot in lived(world, 3))][:-1]
    np.testing.assert_allclose(world.now.energy, np.sum(powers, axis=0) * STEP)


def test_the_calendar_has_no_end() -> None:
    calendar = Calendar(2, 1)
    assert calendar.at(0).outdoor == calendar.at(52 * 7 * DAY).outdoor
    week, later = ([calendar.at(start + k * 600).gain.sum() for k in range(1008)] for start in (0, 60 * 7 * DAY))
    assert max(week) > 200
    assert max(later) > 200
    assert week != later


def test_a_valve_at_its_end_does_not_wind_up() -> None:
    valve = PiValve(power=1000.0, gain=500.0, integral_time=600.0)
    memory = 0.0
    for _ in range(1000):
        memory, power = valve.step(memory, -5.0, 5.0)
    assert power == 1000
    memory, power = valve.step(memory, 0.5, 5.0)
    assert power < 500
    for _ in range(2000):
        memory, power = valve.step(memory, 0.5, 5.0)
    assert power == 0
