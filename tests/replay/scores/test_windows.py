from datetime import UTC, datetime

import numpy as np
import pytest

from estimator.network.presets import PRESETS
from replay.scores.windows import Window, daily_windows, open_loop_errors, quiet_segments
from replay.simulated.simulate import simulate

PERIOD = 600


def utc(*when: int) -> int:
    return int(datetime(*when, tzinfo=UTC).timestamp())  # type: ignore[arg-type, misc]


def test_quiet_segments_are_long_enough_and_unbroken() -> None:
    dominated = np.zeros(400, dtype=bool)
    dominated[[72, 144, 200]] = True  # runs of 72, 71, 55 and 199 steps; 12 h are 72 steps
    assert quiet_segments(dominated, PERIOD) == [Window(0, 72), Window(201, 400)]
    assert quiet_segments(dominated, PERIOD, shortest=55 * PERIOD)[2] == Window(145, 200)
    assert quiet_segments(np.ones(400, dtype=bool), PERIOD) == []


def test_nights_are_local_and_whole() -> None:
    # Konstanz in summer is UTC+2: 20:00 to 06:00 are 18:00 to 04:00 UTC
    times = np.arange(utc(2025, 5, 3), utc(2025, 5, 6), 300)
    nights = daily_windows(times, 300, "Europe/Berlin", 20, 6)
    assert [(times[w.begin], times[w.end - 1]) for w in nights] == [
        (utc(2025, 5, 3, 18), utc(2025, 5, 4, 3, 55)),
        (utc(2025, 5, 4, 18), utc(2025, 5, 5, 3, 55)),
    ]
    days = daily_windows(times, 300, "Europe/Berlin", 7, 17)
    assert [times[w.begin] for w in days] == [utc(2025, 5, d, 5) for d in (3, 4, 5)]


@pytest.mark.parametrize("period", [60, 300, 480, 600, 720, 900, 1200, 3600])
def test_windows_are_found_whatever_the_period(period: int) -> None:
    times = np.arange(utc(2025, 5, 3), utc(2025, 5, 6), period)
    assert len(daily_windows(times, period, "UTC", 20, 6)) == 2
    for end in (16, 17):
        assert len(daily_windows(times, period, "UTC", 7, end)) == 3


def test_a_night_with_a_gap_is_left_out_and_so_are_days_in_between() -> None:
    times = np.arange(utc(2025, 5, 3), utc(2025, 5, 6), 300)
    broken = np.delete(times, np.flatnonzero(times == utc(2025, 5, 3, 23)))
    assert len(daily_windows(broken, 300, "Europe/Berlin", 20, 6)) == 1
    # the whole day between two nights is missing: both nights stay
    gap = (times >= utc(2025, 5, 4, 4)) & (times < utc(2025, 5, 4, 18))
    assert len(daily_windows(times[~gap], 300, "Europe/Berlin", 20, 6)) == 2


def test_the_night_of_the_clock_change_lasts_an_hour_longer() -> None:
    window = daily_windows(np.arange(utc(2025, 10, 25), utc(2025, 10, 27), 300), 300, "Europe/Berlin", 20, 6)[0]
    assert (window.end - window.begin) * 300 == 11 * 3600


def test_the_true_parameters_simulate_the_true_building() -> None:
    network = PRESETS["building-67"]
    rng = np.random.default_rng(1)
    inputs = np.column_stack([rng.normal(8, 4, 500), rng.uniform(0, 800, 500), rng.uniform(0, 600, 500)])
    states = simulate(network, {}, inputs, PERIOD, x0=np.array([20.0, 19.0, 15.0, 25.0, 20.0]))
    truth = np.array([parameter.nominal for parameter in network.parameters], dtype=float)
    windows = [Window(0, 100), Window(250, 500)]
    errors = open_loop_errors(network, truth, PERIOD, windows, states, inputs, states[:, 0])
    np.testing.assert_allclose(errors, 0.0, atol=1e-9)
    shifted = open_loop_errors(network, truth, PERIOD, windows, states, inputs, states[:, 0] + 0.25)
    assert shifted == pytest.approx([0.25, 0.25])
    leaky = truth.copy()
    leaky[-1] *= 2
    wrong = simulate(network, {"g_e_out": leaky[-1]}, inputs[:100], PERIOD, x0=states[0])
    expected = np.sqrt(np.mean((wrong[1:, 0] - states[1:100, 0]) ** 2))
    assert open_loop_errors(network, leaky, PERIOD, windows[:1], states, inputs, states[:, 0]) == pytest.approx(
        expected
    )
