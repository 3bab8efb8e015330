"""The floor: nothing to learn, nothing unknown but the noise."""

import numpy as np
import pytest

from estimator.gaussian.floor import GAIN_CHANNEL, floor, with_known_gain
from estimator.network.presets import PRESETS
from replay.scores.intervals import coverage, rmse, winkler
from replay.simulated.semi_synthetic import MEASUREMENT_NOISE_SD, PERIOD, PROCESS_NOISE_SD, generate

NOISE = {"process_sd": PROCESS_NOISE_SD, "measurement_sd": MEASUREMENT_NOISE_SD}


def scores(estimator, recording):
    """RMSE against the true T_i, Winkler score and coverage of the 95 % interval, one step ahead."""
    columns = recording.columns | {GAIN_CHANNEL: recording.truth.unmeasured_gain}
    inputs = np.column_stack([columns[channel] for channel in estimator.network.inputs])
    outputs = recording.columns["T_i"][:, None]
    state, rows = estimator.start(1, outputs[0], inputs[0]), []
    for u, y in zip(inputs[:-1], outputs[1:], strict=True):
        state = estimator.predict(state, u)
        mixture = estimator.predictive(state)
        rows.append([mixture.means[0, 0], *mixture.quantiles(np.array([0.025, 0.975]), 0)])
        state = estimator.update(state, y).state
    mean, lower, upper = np.array(rows).T
    y = outputs[1:, 0]
    return rmse(mean - recording.truth.states[1:, 0]), winkler(y, lower, upper, 0.95), coverage(y, lower, upper)


def test_the_floor_is_calibrated_and_ignoring_the_gain_costs():
    """With sd s of the predicted temperature and r of the noise, a calibrated interval scores 4.676 sqrt(s^2 + r^2).

    The standard deviation of one interval's score is about .8 of that, and there are 4,031.
    """
    recording = generate(None, days=28, seed=3)
    error, score, covered = scores(floor(with_known_gain(PRESETS["building-67"], "T_i"), PERIOD, **NOISE), recording)
    assert covered == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 4000))
    assert score == pytest.approx(4.676 * np.hypot(error, MEASUREMENT_NOISE_SD), rel=0.05)
    ignorant = scores(floor(PRESETS["building-67"], PERIOD, **NOISE), recording)
    assert ignorant[0] > 3 * error
    assert ignorant[1] > 3 * score
