import numpy as np
import pytest

from replay.localtime import DAY, HOUR, midnight
from replay.recorded.raw_telemetry import (
    Faults,
    Sensor,
    kept_rows,
    measured,
    row_times,
    switched,
    with_missing,
    with_outage,
)

BERLIN = "Europe/Berlin"


def _rng() -> np.random.Generator:
    return np.random.default_rng(1)


def test_rows_are_irregular_within_the_cadence_and_fill_the_period() -> None:
    times = row_times(1000, 1000 + DAY, (10, 60), _rng())
    steps = np.diff(times)
    assert times[0] == 1000
    assert DAY + 1000 - 60 <= times[-1] < DAY + 1000
    assert (steps.min(), steps.max()) == (10, 60)


def test_sensor_adds_noise_and_rounds_to_its_resolution() -> None:
    grid = np.arange(0, 10_000, 60)
    times = np.arange(30, 9000, 7)
    readings = measured(Sensor(0.06, 0.1), times, grid, 20.0 + grid / 1e4, _rng())
    np.testing.assert_allclose(readings * 10, np.round(readings * 10), atol=1e-9)
    error = readings - (20.0 + times / 1e4)
    assert error.std() == pytest.approx(np.hypot(0.06, 0.1 / np.sqrt(12)), rel=0.1)


def test_switched_values_hold_until_the_next() -> None:
    np.testing.assert_array_equal(
        switched(np.array([0, 59, 60, 200]), np.array([0, 60]), np.array([1.0, 2.0])), [1, 1, 2, 2]
    )


def test_gaps_late_rows_and_empty_cells_are_as_many_as_asked() -> None:
    start = midnight(2025, 5, 3, BERLIN)
    times = row_times(start, start + 5 * DAY, (10, 60), _rng())
    rows = kept_rows(times, Faults((1200.0, 5 * HOUR), 3, 0.0), BERLIN, _rng())
    written = times[rows]
    assert len(np.unique(rows)) == len(rows)
    assert 1 <= (np.diff(written) < 0).sum() <= 3
    holes = np.sort(np.diff(np.sort(written)))[-2:]
    assert holes[0] == pytest.approx(1200, abs=121)
    assert holes[1] == pytest.approx(5 * HOUR, abs=121)


def test_faults_stay_away_from_the_clock_change() -> None:
    start, change = midnight(2025, 10, 25, BERLIN), midnight(2025, 10, 26, "UTC") + HOUR
    times = row_times(start, start + 3 * DAY, (10, 60), _rng())
    rows = kept_rows(times, Faults((6 * HOUR, 6 * HOUR, 6 * HOUR), 200, 0.0), BERLIN, _rng())
    near = np.abs(times[rows] - change) < 3 * HOUR
    assert near.sum() == (np.abs(times - change) < 3 * HOUR).sum()
    assert (np.diff(times[rows][near]) > 0).all()


def test_missing_cells_and_outages_leave_nan() -> None:
    times = np.arange(0, 100_000, 10)
    assert np.isnan(with_missing(np.ones(10_000), 0.1, _rng())).mean() == pytest.approx(0.1, abs=0.015)
    silent = np.isnan(with_outage(np.ones(10_000), times, 500, 60))
    np.testing.assert_array_equal(times[silent], [500, 510, 520, 530, 540, 550])
