"""Figures 8 and 9 of the paper, and the nights of table 8."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from estimator.arrays import Array
from replay.experiments.report import Plot
from replay.experiments.semi_synthetic.plots import COLOURS
from replay.experiments.series.filtering import Series, Trace
from replay.localtime import DAY, HOUR, wall_clock
from replay.simulated.ecolar import ZONE

_WEEK = 6 * DAY


def week(name: str, series: Series, trace: Trace) -> Plot:
    """Fig. 9: some days from the fifth on, or from the beginning of a shorter period."""
    begin = series.times[0] + (4 * DAY if series.times[-1] - series.times[0] > 4 * DAY + _WEEK else 0)
    rows = np.flatnonzero((series.times >= begin) & (series.times < begin + _WEEK))
    local = wall_clock(series.times[rows], ZONE).astype("datetime64[s]")
    y, lower, upper = series.outputs[rows, 0], trace.lower[rows], trace.upper[rows]
    titles = ("degC", "residual, K", "width, K", "alpha")
    figure = make_subplots(4, 1, shared_xaxes=True, vertical_spacing=0.04, row_heights=[0.4, 0.2, 0.2, 0.2])
    thin = {"width": 1}
    figure.add_trace(go.Scatter(x=local, y=lower, line={"width": 0}, showlegend=False), 1, 1)
    figure.add_trace(go.Scatter(x=local, y=upper, line={"width": 0}, fill="tonexty", name="95 % interval"), 1, 1)
    measured = {"mode": "markers", "marker": {"size": 2, "color": "#1b2430"}, "name": "measured"}
    figure.add_trace(go.Scatter(x=local, y=y, **measured), 1, 1)
    for row, values in enumerate((y - trace.mean[rows], upper - lower, trace.alpha[rows, 1]), start=2):
        figure.add_trace(go.Scatter(x=local, y=values, line=thin | {"color": COLOURS[0]}, showlegend=False), row, 1)
    for row, title in enumerate(titles, start=1):
        figure.update_yaxes(title=title, row=row, col=1)
    return Plot(
        f"{name}: six days of forecasts, five minutes ahead (Fig. 9)",
        figure,
        "RBPF default, first seed, local time. Where alpha rises the interval widens: heat acts that no sensor sees. "
        "The residual should be noise around zero at night.",
        height=700,
    )


def rhythm(name: str, series: Series, trace: Trace) -> Plot:
    """Fig. 8: median and middle half of alpha by local hour."""
    hour = wall_clock(series.times, ZONE) % DAY // HOUR
    quantiles = np.full((24, 3), np.nan)
    for h in range(24):
        values = trace.alpha[hour == h, 1]
        if values.size:
            quantiles[h] = np.nanquantile(values, [0.25, 0.5, 0.75])
    error = {
        "type": "data",
        "symmetric": False,
        "array": quantiles[:, 2] - quantiles[:, 1],
        "arrayminus": quantiles[:, 1] - quantiles[:, 0],
    }
    points = go.Scatter(x=np.arange(24), y=quantiles[:, 1], error_y=error, mode="markers+lines", showlegend=False)
    figure = go.Figure(points).update_layout(xaxis_title="hour of the day", yaxis={"title": "alpha", "type": "log"})
    return Plot(
        f"{name}: alpha over the day (Fig. 8)",
        figure,
        "RBPF default, first seed: hourly medians; bars are the middle half of the values.",
    )


def nights(learned: Mapping[str, Array], fitted: Mapping[str, Array]) -> Plot:
    """The distribution behind table 8."""
    figure = go.Figure()
    for place, (label, errors) in enumerate((("RBPF default", learned), ("least squares, offline", fitted))):
        for period, values in errors.items():
            figure.add_trace(
                go.Box(
                    y=values,
                    x=[period] * len(values),
                    name=label,
                    legendgroup=label,
                    showlegend=period == next(iter(errors)),
                    marker_color=COLOURS[place],
                )
            )
    figure.update_layout(boxmode="group", yaxis_title="RMSE of a night, K")
    return Plot(
        "Every night by itself",
        figure,
        "First seed. The middle line is the median of the table; a long upper whisker means nights on which a plan "
        "would have gone wrong.",
    )
