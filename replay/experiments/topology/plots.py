"""Residuals of the candidates: over time, over the day, and by lag."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go

from estimator.arrays import Array
from replay.experiments.series.recorded_zone import ZoneRecord
from replay.experiments.topology.fit import LAG_HORIZON, on_grid
from replay.localtime import DAY, HOUR, wall_clock
from replay.reports.kit.report import Plot

COLOURS = ("#0b5c8a", "#c2571a", "#3d8b4f", "#8a3b8f", "#a8841a", "#4a5a6a", "#b3324b", "#1f9aa0", "#767676")
_DRAWN = 2500
"""Points of a line at most: more are not to be seen and make the page heavy."""


def over_time(record: ZoneRecord, residuals: Mapping[str, Array]) -> Plot:
    """Simulated minus measured, candidate by candidate."""
    every = -(-len(record.times) // _DRAWN)
    stamps = np.datetime_as_string(record.times[::every].astype("datetime64[s]"))
    lines = {name: np.round(residual[::every], 3) for name, residual in residuals.items()}
    return Plot(
        "What the simulations miss",
        _drawn(stamps, lines, "UTC", "simulated − measured [K]"),
        "Each model runs through the whole recording without ever being told the measured temperature. A wave with the "
        "sun, in every line, is heat that no channel brings; a line that drifts apart from the others, a network that "
        "is too simple.",
    )


def over_the_day(record: ZoneRecord, residuals: Mapping[str, Array], time_zone: str) -> Plot:
    """Median residual by local hour."""
    hour = (wall_clock(record.times, time_zone) % DAY) // HOUR
    lines = {name: np.array([_median(residual[hour == h]) for h in range(24)]) for name, residual in residuals.items()}
    return Plot(
        "When they miss it",
        _drawn(np.arange(24), lines, f"hour of the day, {time_zone}", "median residual [K]"),
        "Below zero the room was warmer than the model could know: sun and people by day. What is left at night is the "
        "model's own fault.",
    )


def by_lag(record: ZoneRecord, residuals: Mapping[str, Array]) -> Plot:
    """Autocorrelation of the residuals up to the horizon of J_acf."""
    lags = np.arange(int(LAG_HORIZON // record.period) + 1)
    lines = {name: _autocorrelation(on_grid(record, residual), lags) for name, residual in residuals.items()}
    return Plot(
        "How long a miss lasts",
        _drawn(lags * record.period / HOUR, lines, "lag [h]", "autocorrelation of the residual"),
        "J_acf adds up the squares of this curve. An open-loop residual is smooth, so it is near 1 at short lags for "
        "every network; the sooner it falls, the less structure is left to explain.",
    )


def _drawn(x: npt.NDArray[Any], lines: Mapping[str, Array], along: str, up: str) -> go.Figure:
    figure = go.Figure()
    for place, (name, values) in enumerate(lines.items()):
        line = {"color": COLOURS[place % len(COLOURS)], "width": 1.5}
        figure.add_trace(go.Scatter(x=x, y=values, name=name, line=line))
    figure.add_hline(y=0.0, line={"color": "#1b2430", "width": 1})
    return figure.update_layout(xaxis_title=along, yaxis_title=up)


def _autocorrelation(residual: Array, lags: npt.NDArray[Any]) -> Array:
    e = residual - np.nanmean(residual)
    products = [e[lag:] * e[: len(e) - lag] for lag in lags]
    return np.array([np.nanmean(p) if np.isfinite(p).any() else np.nan for p in products]) / np.nanmean(e**2)


def _median(values: Array) -> float:
    kept = values[np.isfinite(values)]
    return float(np.median(kept)) if kept.size else float("nan")
