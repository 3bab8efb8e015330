"""Scores of forecasts, of learned parameters and of what alpha says (paper 3.5, 4.3.3 and 4.3.7)."""

from replay.scores.intervals import (
    LEVEL,
    IntervalScores,
    coverage,
    interval_scores,
    mean_width,
    pit_histogram,
    rmse,
    winkler,
)
from replay.scores.learning import area_under_roc, parasitic_learning_index, update_magnitudes
from replay.scores.residuals import residual_autocorrelation, residual_cross_correlation
from replay.scores.transfer import TransferErrors, frequency_response, transfer_errors
from replay.scores.windows import Window, daily_windows, open_loop_errors, quiet_segments

__all__ = [
    "LEVEL",
    "IntervalScores",
    "TransferErrors",
    "Window",
    "area_under_roc",
    "coverage",
    "daily_windows",
    "frequency_response",
    "interval_scores",
    "mean_width",
    "open_loop_errors",
    "parasitic_learning_index",
    "pit_histogram",
    "quiet_segments",
    "residual_autocorrelation",
    "residual_cross_correlation",
    "rmse",
    "transfer_errors",
    "update_magnitudes",
    "winkler",
]
