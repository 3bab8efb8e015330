"""A row of a zone's history."""

from __future__ import annotations

import math
from typing import NamedTuple

from service.records.update import Update


class HistoryRow(NamedTuple):
    """One update in numbers: the first output (degC, K) against its forecast, and the first volatility block, if any.

    `mean`, `lower`, `upper`, `sd` and `residual` belong to the forecast that stood before `y` was seen; NaN where there
    was none, and `y` is NaN where it was missing. `time` is UTC seconds. The gain is unmeasured heat [W], NaN where the
    estimator has no model of it; the set-point [degC] is NaN where nobody says it.
    """

    time: int
    y: float
    mean: float
    lower: float
    upper: float
    sd: float
    residual: float
    alpha_lower: float
    alpha_median: float
    alpha_upper: float
    cdf: float
    gate: float
    n_eff: float
    resampled: bool
    log_likelihood: float
    segment: int
    gain_lower: float = math.nan
    gain_median: float = math.nan
    gain_upper: float = math.nan
    setpoint: float = math.nan

    @classmethod
    def of(cls, update: Update) -> HistoryRow:
        """The row of `update`."""
        score, volatility = update.score, update.volatility
        scored, alpha = (math.nan,) * 5, (math.nan,) * 4
        if score is not None:
            scored = (score.mean[0], score.lower[0], score.upper[0], score.sd[0], score.residual[0])
        if volatility.blocks:
            alpha = (volatility.lower[0], volatility.median[0], volatility.upper[0], volatility.cdf[0])
        gain = (math.nan,) * 3 if update.disturbance is None else update.disturbance.gain
        return cls(
            update.time,
            update.y[0],
            *scored,
            *alpha,
            gate=update.shown_gate.value,
            n_eff=update.shown_sample_size,
            resampled=update.resampled,
            log_likelihood=update.log_likelihood,
            segment=update.segment,
            gain_lower=gain[0],
            gain_median=gain[1],
            gain_upper=gain[2],
            setpoint=update.setpoint,
        )
