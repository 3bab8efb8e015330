"""What estimators have learned, against what a simulator knows."""

import importlib.util
import logging

import numpy as np
import pytest
from support.energyplus import needs_energyplus

from replay.experiments.hours_ahead.figures import GAIN, GAIN_COVERAGE, LEARNING, LOSS, learned
from replay.experiments.hours_ahead.recordings import Known, recordings
from replay.experiments.request import Request
from replay.lab.experiments import recordings as catalogue
from replay.lab.experiments.recordings import RECORDINGS

TIMES = 1800 * np.arange(28 * 48, dtype=np.int64)
LATER = TIMES >= LEARNING


def arrays(gain: np.ndarray, loss: np.ndarray) -> dict[str, np.ndarray]:
    return {"gain": gain, "heat_loss": loss, "heat_loss_rows": 48 * np.arange(28)}


def test_errors_are_relative_to_the_truth_after_three_weeks() -> None:
    truth = np.where(np.random.default_rng(1).random(len(TIMES)) < 0.3, 500.0, 60.0)
    truth[0] = np.nan
    # Right by 100 W too much, with an interval of 300 W, after weeks of nonsense.
    median = np.where(LATER, truth + 100.0, 1e6)
    gain = np.column_stack([median - 150.0, median, median + 150.0])
    loss = np.array([100.0] * 21 + [80.0] + [2.0] * 6)
    found = learned(Known(truth, 100.0), TIMES, arrays(gain, loss))
    assert found[LOSS] == pytest.approx(0.8), "the first value after three weeks"
    assert found[GAIN] == pytest.approx(100.0 / np.sqrt(np.mean(truth[LATER] ** 2)))
    assert found[GAIN_COVERAGE] == 1.0


def test_what_was_not_known_has_no_figure() -> None:
    truth = np.full(len(TIMES), 100.0)
    unknown = arrays(np.full((len(TIMES), 3), np.nan), np.empty(0))
    unknown["heat_loss_rows"] = np.empty(0, dtype=np.int64)
    assert learned(Known(truth, 100.0), TIMES, unknown) == {}
    # A recording that is too short teaches nothing, whatever its estimator says.
    short = slice(5 * 48)
    early = arrays(np.zeros((5 * 48, 3)), np.ones(5)) | {"heat_loss_rows": 48 * np.arange(5)}
    assert learned(Known(truth[short], 100.0), TIMES[short], early) == {}


@needs_energyplus
def test_a_building_of_energyplus_is_a_recording_with_its_truth() -> None:
    recording = RECORDINGS["EnergyPlus house"](None)
    assert len(recording.series.times) == 28 * 288
    assert recording.network.inputs == ("T_out", "T_adj_upper", "u_heat", "I_sol")
    assert not recording.measured
    assert 65 < recording.known.heat_loss < 85, "the upper floor is no outdoors"
    assert np.isnan(recording.known.gain[0])
    assert np.nanmin(recording.known.gain[1:]) < -1000, "open windows"
    assert np.nanmax(recording.known.gain) > 1500, "cooking"
    week = recording.first_days(7)
    assert len(week.known.gain) == len(week.series.times) == 7 * 288
    np.testing.assert_array_equal(week.known.gain[1:], recording.known.gain[1 : 7 * 288])


def test_without_energyplus_one_sentence_says_what_is_left_out(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    kept = ("building 67", "EnergyPlus house", "EnergyPlus office")
    monkeypatch.setattr(catalogue, "RECORDINGS", {name: RECORDINGS[name] for name in kept})
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with caplog.at_level(logging.WARNING):
        found = recordings(Request(days=2))
    assert [recording.name for recording in found] == ["building 67"]
    (said,) = caplog.messages
    assert said.startswith("the buildings of EnergyPlus are left out: EnergyPlus is not installed; install the extra")
