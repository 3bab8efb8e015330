import numpy as np
import pytest

from replay.localtime import DAY, HOUR, midnight
from replay.recorded.raw_telemetry import Faults, Sensor, kept_rows, measured, row_times

BERLIN = "Europe/Berlin"


def _rng():
    return np.random.default_rng(1)


def test_sensor_adds_noise_and_rounds_to_its_resolution():
    grid = np.arange(0, 10_000, 60)
    times = np.arange(30, 9000, 7)
    readings = measured(Sensor(0.06, 0.1), times, grid, 20.0 + grid / 1e4, _rng())
    np.testing.assert_allclose(readings * 10, np.round(readings * 10), atol=1e-9)
    error = readings - (20.0 + times / 1e4)
    assert error.std() == pytest.approx(np.hypot(0.06, 0.1 / np.sqrt(12)), rel=0.1)


def test_faults_stay_away_from_the_clock_change():
    start, change = midnight(2025, 10, 25, BERLIN), midnight(2025, 10, 26, "UTC") + HOUR
    times = row_times(start, start + 3 * DAY, (10, 60), _rng())
    rows = kept_rows(times, Faults((6 * HOUR, 6 * HOUR, 6 * HOUR), 200, 0.0), BERLIN, _rng())
    near = np.abs(times[rows] - change) < 3 * HOUR
    assert near.sum() == (np.abs(times - change) < 3 * HOUR).sum()
    assert (np.diff(times[rows][near]) > 0).all()
