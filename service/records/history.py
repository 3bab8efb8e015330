"""A row of a zone's history."""

import math
from typing import Any, Literal, Self

from service.records.record import Number, Time, constant, names, record, shown
from service.records.update import Update


@record
class HistoryRow:
    """One sample against the forecast that stood before it was seen."""

    # Of the first output and the first volatility block. NaN: no forecast stood, nothing was measured, the estimator
    # has no model of it, or nobody says it.
    time: Time
    y: Number = shown("measured, degC")
    mean: Number = shown("degC")
    lower: Number = shown("degC, at the first published level")
    upper: Number = shown("degC, at the first published level")
    sd: Number = shown("K")
    residual: Number = shown("y - mean, K")
    alpha_lower: Number = shown(".025 quantile")
    alpha_median: Number
    alpha_upper: Number = shown(".975 quantile")
    cdf: Number
    gate: Number
    n_eff: Number
    resampled: bool
    log_likelihood: Number
    segment: int
    gain_lower: Number = shown("unmeasured heat, .025 quantile, W; null where the estimator knows of none")
    gain_median: Number = shown("W")
    gain_upper: Number = shown(".975 quantile, W")
    setpoint: Number = shown("set-point, degC; null where none was told")

    @classmethod
    def of(cls, update: Update) -> Self:
        score, volatility = update.score, update.volatility
        scored, alpha = (math.nan,) * 5, (math.nan,) * 4
        if score is not None:
            scored = (score.mean[0], score.lower[0], score.upper[0], score.sd[0], score.residual[0])
        if volatility.blocks:
            alpha = (volatility.lower[0], volatility.median[0], volatility.upper[0], volatility.cdf[0])
        gain = (math.nan,) * 3 if update.disturbance is None else update.disturbance.gain
        filtered = update.shown_gate.value, update.shown_sample_size, update.resampled, update.log_likelihood
        row: list[Any] = [update.time, update.y[0], *scored, *alpha, *filtered, update.segment]
        return cls(*[*row, *gain, update.setpoint])


HISTORY_COLUMNS = names(HistoryRow)
"""The columns of stored and exported histories."""


@record
class History:
    """Samples in time order, for the first output."""

    output: str
    unit: Literal["degC"] = constant("degC")
    period_s: float
    rows: tuple[HistoryRow, ...]
