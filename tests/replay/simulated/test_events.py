import numpy as np
import pytest

from replay.localtime import DAY, HOUR, midnight, weekday
from replay.simulated.events import HEATER, UNMEASURED_GAIN, Habit, SquareWave, habitual, square_wave


def _runs(on: np.ndarray) -> np.ndarray:
    """Lengths of the complete runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    return edges[1::2] - edges[::2]


@pytest.mark.parametrize(("wave", "period"), [(HEATER, 600.0), (UNMEASURED_GAIN, 600.0), (HEATER, 300.0)])
def test_square_wave_has_the_stated_amplitude_durations_and_duty(wave: SquareWave, period: float) -> None:
    samples = 400_000
    flow = square_wave(wave, samples, period, np.random.default_rng(1))
    assert set(np.unique(flow)) == {0.0, wave.amplitude}
    runs = _runs(flow > 0)[:-1] * period
    assert runs.min() == wave.shortest
    assert np.mean(runs <= wave.longest) > 0.9  # two events may follow each other at once and read as one
    off = period / (1 - (1 - wave.start_probability) ** (period / wave.per))
    on = (wave.shortest + wave.longest) / 2
    events = samples * period / (on + off)
    assert (flow > 0).mean() == pytest.approx(on / (on + off), rel=5 / np.sqrt(events))


def test_habits_keep_to_their_days_hours_and_strength() -> None:
    start = midnight(2025, 5, 5, "UTC")  # a Monday; wall clock and UTC are one here
    local = np.arange(start, start + 28 * DAY, 60)
    office = Habit((0, 1, 2, 3, 4), (7.0, 18.0), 1.0, (HOUR, 4 * HOUR), (100.0, 200.0))
    total = habitual((office,), local, np.random.default_rng(1))
    acting = total > 0
    assert acting.any()
    assert set(weekday(local[acting])) == {0, 1, 2, 3, 4}
    hours = local[acting] % DAY / HOUR
    assert hours.min() >= 7
    assert hours.max() < 18
    assert total[acting].min() >= 100.0
