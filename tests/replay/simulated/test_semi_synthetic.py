from pathlib import Path

import numpy as np
import pytest

from estimator.network.presets import building_67
from replay.errors import WeatherFileError
from replay.scores.intervals import coverage, mean_width, rmse, winkler
from replay.simulated.semi_synthetic import (
    MEASUREMENT_NOISE_SD,
    PERIOD,
    PROCESS_NOISE_SD,
    Recording,
    generate,
    read_weather,
)
from replay.simulated.simulate import dynamics

LYNGBY = Path(__file__).parents[4] / "shared/data/semi_synthetic/weather_lyngby_2016_10min.csv"
needs_lyngby = pytest.mark.skipif(not LYNGBY.exists(), reason=f"measured weather is not at {LYNGBY}")


def _kalman(recording: Recording, *, gain_known: bool) -> dict[str, float]:
    """One-step scores of a Kalman filter that knows the true parameters and noise."""
    network = building_67()
    step = dynamics(network, {}, PERIOD)
    inputs = np.column_stack([recording.columns[channel] for channel in network.inputs])
    drive = inputs @ step.input.T
    if gain_known:
        drive += recording.truth.unmeasured_gain[:, None] * step.heat[:, 0]
    y = recording.columns["T_i"]
    mean, covariance = np.full(5, y[0]), 0.2**2 * np.eye(5)
    forecast, sd = np.full(len(y), np.nan), np.full(len(y), np.nan)
    for k in range(1, len(y)):
        mean = step.transition @ mean + drive[k - 1]
        covariance = step.transition @ covariance @ step.transition.T + PROCESS_NOISE_SD**2 * np.eye(5)
        variance = covariance[0, 0] + MEASUREMENT_NOISE_SD**2
        forecast[k], sd[k] = mean[0], np.sqrt(variance)
        gain = covariance[:, 0] / variance
        mean = mean + gain * (y[k] - mean[0])
        covariance = covariance - np.outer(gain, covariance[0])
    lower, upper = forecast - 1.96 * sd, forecast + 1.96 * sd
    dominated = recording.truth.disturbance_dominated
    return {
        "rmse": rmse(forecast - recording.truth.states[:, 0]),
        "winkler": winkler(y, lower, upper, 0.95),
        "coverage": coverage(y, lower, upper),
        "low": coverage(y[~dominated], lower[~dominated], upper[~dominated]),
        "dominated": coverage(y[dominated], lower[dominated], upper[dominated]),
        "width": mean_width(lower, upper),
    }


@needs_lyngby
def test_filters_that_know_the_building_score_the_published_floor_with_and_without_the_gain() -> None:
    recording = generate(LYNGBY, seed=1)
    known, ignored = (_kalman(recording, gain_known=known) for known in (True, False))
    assert known["rmse"] == pytest.approx(0.064, abs=0.002)
    assert known["winkler"] == pytest.approx(0.772, abs=0.02)
    assert known["width"] == pytest.approx(0.640, abs=0.002)
    # 5 standard errors of a proportion from 22,176 samples
    assert known["coverage"] == pytest.approx(0.95, abs=5 * np.sqrt(0.95 * 0.05 / 22_176))
    gain = recording.truth.unmeasured_gain
    events = np.count_nonzero((gain[1:] > 0) & (gain[:-1] == 0))
    # What the gain does comes in `events` pieces of variable size: a relative error of about sqrt(2 / events), thrice.
    spread = 3 * np.sqrt(2 / events)
    assert ignored["rmse"] ** 2 == pytest.approx(0.274**2, rel=spread)
    assert 1 - ignored["low"] == pytest.approx(1 - 0.886, rel=spread)
    assert ignored["dominated"] == pytest.approx(0.071, rel=spread)


def test_same_seed_same_numbers_and_fewer_days_are_a_beginning() -> None:
    long, short = generate(None, days=4, seed=5), generate(None, days=2, seed=5)
    assert len(short.times) == 2 * 144
    np.testing.assert_array_equal(long.truth.states[: 2 * 144], short.truth.states)
    np.testing.assert_array_equal(generate(None, days=2, seed=5).columns["T_i"], short.columns["T_i"])
    assert (generate(None, days=2, seed=6).columns["T_i"] != short.columns["T_i"]).any()


def test_label_marks_the_interval_that_ends_at_the_step() -> None:
    truth = generate(None, days=30, seed=1).truth
    assert truth.disturbance_dominated.any()
    assert not truth.disturbance_dominated[0]
    np.testing.assert_array_equal(truth.disturbance_dominated[1:], truth.unmeasured_gain[:-1] > 0)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("timestamp_utc,T_out_degC\n2016-04-10 00:00:00,3\n", "GHI_W_m2"),
        ("timestamp_utc,T_out_degC,GHI_W_m2\n2016-04-10 00:00:00,cold,0\n", "not a time or a number"),
        ("timestamp_utc,T_out_degC,GHI_W_m2\n2016-04-10 00:00:00,3,0\n2016-04-10 00:15:00,3,0\n", "600 s apart"),
        ("timestamp_utc,T_out_degC,GHI_W_m2\n2016-04-10 00:00:00,3,0\n2016-04-10 00:10:00,nan,0\n", "600 s apart"),
        ("timestamp_utc,T_out_degC,GHI_W_m2\n", "600 s apart"),
    ],
)
def test_a_weather_file_that_is_none_is_refused_in_one_sentence(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "weather.csv"
    path.write_text(text)
    with pytest.raises(WeatherFileError, match=complaint) as caught:
        generate(path, seed=1)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("offset", ["", "Z", "+00:00"])
def test_the_times_of_a_weather_file_are_utc_and_may_say_so(offset: str, tmp_path: Path) -> None:
    path = tmp_path / "weather.csv"
    rows = [f"2016-04-10 00:{minute}:00{offset},3,0" for minute in ("00", "10")]
    path.write_text("\n".join(["timestamp_utc,T_out_degC,GHI_W_m2", *rows]) + "\n")
    assert read_weather(path)[0].tolist() == [1460246400, 1460247000]
