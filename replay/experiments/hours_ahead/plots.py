"""The figures of the hours-ahead report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from replay.experiments.hours_ahead.horizons import THREE_DAYS
from replay.experiments.hours_ahead.outcome import Outcome, Weights
from replay.experiments.hours_ahead.recordings import Known
from replay.experiments.hours_ahead.rivals import BANK, RBPF
from replay.experiments.hours_ahead.verdicts import values
from replay.experiments.report import Plot
from replay.scores import LEVEL, pit_histogram

COLOURS = (
    "#b9c0c8",
    "#8a94a0",
    "#a8841a",
    "#767676",
    "#4a5a6a",
    "#3d8b4f",
    "#1f9aa0",
    "#e0a08a",
    "#c2571a",
    "#8a3b8f",
    "#0b5c8a",
    "#b3324b",
)


def crps_by_horizon(outcome: Outcome) -> Plot:
    """CRPS of every rival."""
    figure = go.Figure()
    for label, colour in _coloured(outcome):
        mean = [_mean(outcome, label, horizon, "crps") for horizon in outcome.leads]
        line = {"color": colour, "width": 4 if label == BANK else 2}
        figure.add_trace(go.Scatter(x=list(outcome.leads), y=mean, name=label, line=line))
    figure.update_layout(xaxis_title="ahead", yaxis={"title": "CRPS, K", "type": "log"})
    return Plot(
        f"{outcome.recording.name}: error by horizon",
        figure,
        "Mean over seeds, logarithmic. Lower is better. The bank is the thick line.",
    )


def coverage_by_horizon(outcome: Outcome) -> Plot:
    """Coverage of every rival that has intervals."""
    figure = go.Figure()
    for label, colour in _coloured(outcome):
        mean = [_mean(outcome, label, horizon, "coverage") for horizon in outcome.leads]
        if np.isfinite(mean).any():
            line = {"color": colour, "width": 4 if label == BANK else 2}
            figure.add_trace(go.Scatter(x=list(outcome.leads), y=mean, name=label, line=line))
    figure.add_hline(y=LEVEL, line={"dash": "dot", "color": "#1b2430"})
    figure.update_layout(xaxis_title="ahead", yaxis={"title": "coverage", "range": [0, 1.02]})
    return Plot(
        f"{outcome.recording.name}: coverage of the 95 % interval by horizon",
        figure,
        "Mean over seeds. The dotted line is what an interval promises.",
    )


def heat_loss_by_day(outcome: Outcome, known: Known) -> Plot:
    """The heat loss that every physical estimator has learned by then, of the first seed, and the true one."""
    figure = go.Figure()
    for label, colour in _coloured(outcome):
        runs = outcome.learned.get(label, ())
        if runs and np.isfinite(runs[0].by_day).any():
            line = {"color": colour, "width": 4 if label == BANK else 2}
            figure.add_trace(go.Scatter(x=runs[0].days, y=runs[0].by_day, name=label, line=line))
    figure.add_hline(y=known.heat_loss, line={"dash": "dot", "color": "#1b2430"})
    figure.update_layout(xaxis_title="days", yaxis={"title": "heat loss to outdoors, W/K", "type": "log"})
    return Plot(
        f"{outcome.recording.name}: heat loss learned",
        figure,
        "Of the median parameters, first seed. The dotted line is that of EnergyPlus.",
    )


def weights_over_time(outcome: Outcome, weights: Weights) -> Plot:
    """What the members of the bank weigh."""
    horizons = list(outcome.leads)
    figure = make_subplots(len(horizons), 1, shared_xaxes=True, vertical_spacing=0.04, subplot_titles=horizons)
    for place in range(len(horizons)):
        for member, name in enumerate(weights.members):
            figure.add_trace(
                go.Scatter(
                    x=weights.days,
                    y=weights.shares[:, member, place],
                    name=name,
                    legendgroup=name,
                    showlegend=place == 0,
                    stackgroup=str(place),
                    line={"width": 0},
                    fillcolor=COLOURS[-1 - member % len(COLOURS)],
                ),
                place + 1,
                1,
            )
        figure.update_yaxes(range=[0, 1], row=place + 1, col=1)
    figure.update_xaxes(title="days", row=len(horizons), col=1)
    return Plot(
        f"{outcome.recording.name}: the bank's weights",
        figure,
        "First seed. The height of a colour is the share of that member in the forecast at this horizon.",
        height=170 * len(horizons) + 110,
    )


def calibration(outcome: Outcome) -> Plot:
    """PIT histograms of the bank and of the RBPF at every horizon."""
    horizons = list(outcome.leads)
    figure = make_subplots(1, len(horizons), subplot_titles=horizons)
    for label, colour in _coloured(outcome):
        if label not in (BANK, RBPF):
            continue
        for place, (_, lead) in enumerate(outcome.leads.items()):
            rows = outcome.examples[label].pit[outcome.begins[THREE_DAYS] + lead :, place]
            shares = pit_histogram(rows, bins=10)
            trace = go.Scatter(
                x=(np.arange(len(shares)) + 0.5) / len(shares),
                y=shares * len(shares),
                name=label,
                legendgroup=label,
                showlegend=place == 0,
                line={"color": colour, "shape": "hvh"},
            )
            figure.add_trace(trace, 1, place + 1)
    figure.add_hline(y=1.0, line={"dash": "dot", "color": "#1b2430"})
    return Plot(
        f"{outcome.recording.name}: calibration of the whole forecast (PIT)",
        figure,
        "First seed. Flat at 1: the distribution is right throughout. High at both ends: too narrow. A hump: too wide.",
    )


def _coloured(outcome: Outcome) -> list[tuple[str, str]]:
    labels: Sequence[str] = list(outcome.scores[THREE_DAYS])
    return [(label, COLOURS[place % len(COLOURS)]) for place, label in enumerate(labels)]


def _mean(outcome: Outcome, label: str, horizon: str, figure: str) -> float:
    return float(values(outcome, label, horizon, figure).mean())
