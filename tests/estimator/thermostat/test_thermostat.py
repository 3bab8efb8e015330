"""A house that a thermostat heats: its law is recovered, and run inside the simulation it keeps the forecast right."""

import numpy as np
import pytest

from estimator.network.network import Conductance, Gain, HeatInput, Network, Parameter
from estimator.network.presets import network
from estimator.statespace.matrices import of_draws
from estimator.statespace.simulate import sampled_paths
from estimator.thermostat.closed_loop import LawRoom, course_of
from estimator.thermostat.law import Laws, called, identified, no_laws, shortest_times
from estimator.thermostat.memory import in_order, no_memory, remembered, swings
from estimator.types import ModelDraws

PERIOD = 600
HOUSE = network("tite")
"""Inputs T_out and u_heat."""
THETA = np.array([4e6, 4e7, 600.0, 120.0])


def draws(count, theta=THETA, state=(20.0, 18.0), spread=0.0, noise=0.0, of=HOUSE):
    """`count` draws of one model without a gain."""
    size = len(of.nodes)
    return ModelDraws(
        network=of,
        point=theta,
        mean=np.array(state),
        covariance=np.eye(size) * spread**2,
        weights=np.full(count, 1.0 / count),
        theta=np.tile(theta[:, None], count),
        state=np.tile(np.array(state)[:, None], count),
        spread=np.full((size, count), spread),
        gain_decay=np.empty((0, count)),
        gain_stays=1.0,
        process_variance=np.full((size, count), noise**2),
        measurement_variance=np.full((1, count), 0.03**2),
        point_is_fan=True,
    )


def sampled_loops(draws, period, laws, setpoints, rows, before, *, seed=1, origin=0):
    return course_of(draws, period, laws, rows, before, seed=seed, origin=origin).under(setpoints)


def law(power, offset, band, *, switching=False, side=1.0, sign=1.0, column=1.0):
    one = np.ones(1)
    spread = np.diag([0.01 * power, 0.02, 0.02])[None] ** 2
    numbers = np.array([[power, offset, band]])
    return Laws(one * column, one * side, one * sign, one * switching, numbers, spread, one, one)


def both(first, second):
    return Laws(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))


def times(days):
    return np.arange(0, round(days * 86400), PERIOD)


def schedule(when, day=21.0, night=17.0):
    hour = when % 86400 / 3600.0
    return np.where((hour >= 6.5) & (hour < 22.0), day, night)


def weather(when, mean=3.0):
    rows = np.zeros((len(when), 2))
    rows[:, 0] = mean + 5.0 * np.sin(2 * np.pi * (when / 86400 - 0.4))
    return rows


def recorded(laws, days=14.0, mean=3.0, seed=1, noise=0.03, setpoint=schedule):
    """The memory of a house that `laws` heat and cool, with noisy sensors and moving temperatures."""
    when = times(days)
    rows, wanted = weather(when, mean), setpoint(when)
    paths = sampled_loops(draws(1, noise=0.02), PERIOD, exactly(laws), wanted, rows, np.zeros(2), seed=seed, origin=0)
    rows[:, 1] = paths.heat[0].sum(axis=1)
    seen = paths.temperatures[0, :-1, 0] + noise * np.random.default_rng(seed).normal(size=len(when))
    memory, before = no_memory(2), np.full(2, np.nan)
    for i, moment in enumerate(when):
        memory = remembered(memory, int(moment), PERIOD, wanted[i], seen[i], rows[i], before)
        before = rows[i]
    return in_order(memory, when[-1]), paths


def exactly(laws):
    return laws._replace(covariance=laws.covariance * 1e-30)


def given(laws, place, deviation):
    """Of a room that this heat does not warm."""
    return called(laws, place, deviation, deviation, np.zeros(len(deviation)), np.zeros(len(deviation)))


PROPORTIONAL = law(5000.0, 0.5, 1.0)
ON_OFF = law(6000.0, 0.0, 0.4, switching=True)


@pytest.mark.parametrize("truth", [PROPORTIONAL, ON_OFF])
def test_the_law_of_a_heater_is_recovered_with_its_interval(truth):
    found = identified(HOUSE, recorded(truth)[0])
    assert len(found.column) == 1
    assert (found.column[0], found.side[0], found.sign[0]) == (1.0, 1.0, 1.0)
    assert found.switching[0] == truth.switching[0]
    sds = np.sqrt(np.diagonal(found.covariance[0]))
    assert (np.abs(found.numbers[0] - truth.numbers[0]) <= 3.0 * sds).all()
    assert (sds <= [250.0, 0.1, 0.15]).all()
    assert found.explained[0] > 0.8


def test_a_valve_that_is_moved_by_and_by_is_no_relay():
    """Under a controller with an integral part the heat follows that of the interval before, as that of a relay."""
    when = times(14)
    rows, wanted = weather(when), schedule(when, night=18.0)
    air, wall, integral = 19.0, 17.0, 0.3
    memory, before = no_memory(2), np.full(2, np.nan)
    for i, moment in enumerate(when):
        error = wanted[i] - air
        rows[i, 1] = 6000.0 * np.clip(0.15 * error + integral, 0.0, 1.0)
        integral = np.clip(integral + 0.05 * error, 0.0, 0.5)
        memory = remembered(memory, int(moment), PERIOD, wanted[i], air, rows[i], before)
        before, to_wall = rows[i], 600.0 * (air - wall)
        air += PERIOD / 4e6 * (rows[i, 1] - to_wall)
        wall += PERIOD / 4e7 * (to_wall - 120.0 * (wall - rows[i, 0]))
    found = identified(HOUSE, in_order(memory, when[-1]))
    assert found.switching[0] == 0.0
    # Least squares for a relay have half of it, and a hysteresis of 2 K.
    assert found.numbers[0, 0] > 0.8 * rows[:, 1].max()
    assert found.numbers[0, 2] < 1.0


@pytest.mark.parametrize("length", [300, 600])
def test_the_minimum_times_of_a_relay_are_bounded_by_the_shortest_that_were_seen(length):
    """It stays on for 20 to 40 min and off for 30 to 60, in samples of their means."""
    rng, minutes = np.random.default_rng(3), []
    while len(minutes) < 14 * 1440:
        minutes += [6000.0] * rng.integers(20, 41) + [0.0] * rng.integers(30, 61)
    heat = np.array(minutes[: 14 * 1440]).reshape(-1, length // 60).mean(axis=1)
    memory, before = no_memory(2), np.full(2, np.nan)
    for k, watts in enumerate(heat):
        row = np.array([3.0, watts])
        memory = remembered(memory, k * length, length, 20.0, 20.0, row, before)
        before = row
    memory = in_order(memory, 14 * 86400.0)
    on, off = shortest_times(ON_OFF, 0, memory, float(length))
    assert 19.0 * 60.0 <= on <= 24.0 * 60.0
    assert 29.0 * 60.0 <= off <= 35.0 * 60.0
    assert np.isnan(shortest_times(PROPORTIONAL, 0, memory, float(length))).all()
    assert np.isnan(shortest_times(ON_OFF, 0, no_memory(2), float(length))).all()
    assert np.isnan(shortest_times(ON_OFF, 0, memory, 60.0)).all(), "not every minute of it is remembered"


def test_heating_and_cooling_in_one_zone_are_two_laws():
    cooling = law(3000.0, 1.0, 1.0, side=-1.0, sign=-1.0)
    memory = recorded(both(PROPORTIONAL, cooling), mean=19.0, setpoint=lambda when: schedule(when, 23.0, 17.0))[0]
    assert memory.inputs[:, 1].min() < -500.0
    found = identified(HOUSE, memory)
    assert found.side.tolist() == [1.0, -1.0]
    assert found.sign.tolist() == [1.0, -1.0]
    deviation = np.linspace(-3.0, 3.0, 61)
    for place, truth in enumerate((PROPORTIONAL, cooling)):
        apart = given(found, place, deviation) - given(truth, 0, deviation)
        assert np.abs(apart).max() < 0.2 * truth.numbers[0, 0]


def test_a_cooler_with_a_channel_of_its_own_calls_when_it_is_warm():
    cooled = Network(
        name="cooled",
        capacitances={"T_i": "C_i"},
        boundaries=("T_out",),
        conductances=(Conductance("g", ("T_i", "T_out")),),
        heat_inputs=(HeatInput("u_cool", "T_i", Gain(-1.0)),),
        parameters=(Parameter("C_i", "J/K", 1e6, 1e8), Parameter("g", "W/K", 10.0, 1e3)),
        measured=("T_i",),
    )
    when = times(14.0)
    seen = 24.0 + np.sin(when / 9000.0)
    heat = 2000.0 * np.clip((seen - 24.0) / 0.8 + 0.5, 0.0, 1.0)
    rows = np.column_stack([np.full(len(when), 28.0), heat])
    memory = in_order(remembered(no_memory(2), 0, PERIOD, 24.0, seen[0], rows[0], rows[0]), 0)
    memory = memory._replace(
        times=when.astype(float), setpoints=np.full(len(when), 24.0), temperatures=seen, inputs=rows, before=rows
    )
    found = identified(cooled, memory)
    assert (found.side.tolist(), found.sign.tolist()) == ([-1.0], [1.0])
    assert found.numbers[0] == pytest.approx([2000.0, 0.0, 0.8], abs=0.1, rel=0.02)


def test_heat_that_obeys_nobody_has_no_law():
    memory = recorded(PROPORTIONAL)[0]
    memory.inputs[:, 1] = np.random.default_rng(1).permutation(memory.inputs[:, 1])
    assert len(identified(HOUSE, memory).column) == 0
    assert len(identified(HOUSE, no_memory(2)).column) == 0


def test_memory_is_bounded_and_keeps_one_sample_a_slot():
    memory = no_memory(2)
    for moment in range(0, 20 * 86400, 300):
        memory = remembered(memory, moment, 300, 20.0, 19.0, np.full(2, float(moment)), np.zeros(2))
    assert len(memory.times) == 14 * 144
    known = in_order(memory, moment)
    assert (np.diff(known.times) == 600.0).all()
    assert known.times[-1] == moment - 300
    assert (known.inputs[:, 1] == known.times).all()


@pytest.mark.parametrize("truth", [PROPORTIONAL, ON_OFF])
def test_under_known_set_points_the_closed_loop_is_right_to_tenths_of_a_kelvin(truth):
    memory, past = recorded(truth)
    found = identified(HOUSE, memory)
    when = times(15.0)[len(times(14.0)) :]
    last = past.temperatures[0, -1, 0]
    state = (last, last - 1.5)
    rows, wanted = weather(when), schedule(when)
    rows[:, 1] = memory.inputs[-1, 1]
    came = sampled_loops(draws(1, state=state), PERIOD, exactly(truth), wanted, rows, rows[0])
    # A model that is wrong by a fifth in two parameters, as after a fortnight.
    wrong = draws(64, THETA * [1.2, 1.0, 1.0, 0.8], state, spread=0.05, noise=0.02)
    fan = sampled_loops(wrong, PERIOD, found, wanted, rows, rows[0], seed=3, origin=7)
    apart = fan.temperatures[:, :, 0].mean(axis=0) - came.temperatures[0, :, 0]
    assert np.sqrt(np.mean(apart**2)) < 0.4
    held = sampled_paths(wrong, PERIOD, rows, 3, 7)[:, :, 0].mean(axis=0) - came.temperatures[0, :, 0]
    assert np.sqrt(np.mean(held**2)) > 3.0 * np.sqrt(np.mean(apart**2))
    energy, truly = (one.heat[:, :, 0].sum(axis=1) for one in (fan, came))
    assert abs(energy.mean() / truly[0] - 1.0) < 0.3
    assert energy.std() > 0.0


def test_a_relay_that_switches_within_an_interval_has_the_narrow_band_that_it_keeps():
    rng = np.random.default_rng(4)
    memory, _ = recorded(PROPORTIONAL)
    # Every minute 6 kW below 0.2 K under the set-point, and none 0.2 K over it, in a room whose air is quick.
    air, on, seen, heat = 18.0, False, [], []
    for k, setpoint in enumerate(memory.setpoints):
        seen.append(air + 0.02 * rng.standard_normal())
        given = []
        for _ in range(10):
            excess = air - setpoint
            on = excess < 0.0 if abs(excess) > 0.2 else on
            given.append(6000.0 * on)
            air += 60.0 * (given[-1] - 120.0 * (air - memory.inputs[k, 0])) / 5e5
        heat.append(np.mean(given))
    inputs = np.column_stack([memory.inputs[:, 0], heat])
    before = np.vstack([inputs[:1], inputs[:-1]])
    found = identified(HOUSE, memory._replace(temperatures=np.array(seen), inputs=inputs, before=before))
    power, offset, band = found.numbers[0]
    assert power == pytest.approx(6000.0, rel=0.05)
    assert abs(offset) < 0.1
    assert band < 0.6


def test_a_narrow_band_does_not_overshoot_in_a_long_step():
    rows, wanted = weather(times(1.0)), np.full(144, 21.0)
    narrow = exactly(law(9000.0, 0.0, 0.1))
    found = sampled_loops(draws(1), PERIOD, narrow, wanted, rows, rows[0]).temperatures[0, :, 0]
    assert (np.diff(found[: int(np.argmax(found > 20.9))]) > 0.0).all()
    assert np.abs(found[72:] - 21.0).max() < 0.06


def test_without_a_set_point_the_heat_of_the_plan_holds():
    rows, nobody = weather(times(1.0)), np.full(144, np.nan)
    rows[:, 1] = np.linspace(0.0, 3000.0, 144)
    paths = sampled_loops(draws(8, spread=0.1, noise=0.02), PERIOD, ON_OFF, nobody, rows, rows[0], seed=1, origin=2)
    assert (paths.heat[:, :, 0] == rows[:, 1]).all()
    plain = sampled_loops(draws(8, spread=0.1, noise=0.02), PERIOD, no_laws(), nobody, rows, rows[0], seed=1, origin=2)
    assert plain.temperatures == pytest.approx(paths.temperatures, rel=1e-12)


def test_an_on_off_law_keeps_its_state_inside_the_hysteresis():
    rows, wanted = weather(times(0.1))[:14], np.full(14, 20.0)
    off, on = rows[0].copy(), rows[0].copy()
    on[1] = 6000.0
    found = [sampled_loops(draws(1), PERIOD, exactly(ON_OFF), wanted, rows, now) for now in (off, on)]
    assert [paths.heat[0, 0, 0] for paths in found] == [0.0, 6000.0]


def test_the_same_seed_gives_the_same_bits_and_another_step_others():
    rows, wanted = weather(times(1.0)), np.full(144, 21.0)
    several = draws(16, spread=0.1, noise=0.05)

    def run(origin):
        return sampled_loops(several, PERIOD, ON_OFF, wanted, rows, rows[0], seed=1, origin=origin)

    assert run(5).temperatures.tobytes() == run(5).temperatures.tobytes()
    assert run(5).temperatures.tobytes() != run(6).temperatures.tobytes()


def test_a_room_simulated_step_by_step_is_the_closed_loop():
    rows, wanted = weather(times(0.5)), schedule(times(0.5))
    house = draws(4, state=(19.0, 17.0))
    for laws in (PROPORTIONAL, ON_OFF):
        room, path = LawRoom(of_draws(house, PERIOD, 1), laws, wanted, rows[0]), []
        for inputs in rows:
            path.append(room.outputs()[0])
            room.step(inputs)
        whole = sampled_loops(house, PERIOD, exactly(laws), wanted, rows, rows[0]).temperatures[0, :-1, 0]
        assert np.array(path) == pytest.approx(whole, abs=1e-9)
        assert room.anew().outputs()[0] == path[0]


def test_a_room_swings_while_its_thermostat_heats_and_not_while_the_sun_keeps_it_warm():
    def seen(temperatures):
        memory = no_memory(2)
        for step, temperature in enumerate(temperatures):
            setpoint = 17.0 if step % 144 < 36 else 20.0
            memory = remembered(memory, step * PERIOD, PERIOD, setpoint, temperature, np.zeros(2), np.zeros(2))
        return swings(memory, len(temperatures) * PERIOD, 7200.0)

    relay = 20.0 + np.tile([0.6, 0.1, -0.4, -0.3], 288)
    found = seen(relay)
    assert found.shape[1] == 12
    assert len(found) <= 100
    assert found.mean(axis=1) == pytest.approx(np.zeros(len(found)), abs=1e-9)
    assert found.max(axis=1) == pytest.approx(np.full(len(found), 0.6)), "against the set-point of the day alone"
    assert not seen(relay + 1.0).any()
    assert not seen(relay[:24]).any(), "not enough was seen"
