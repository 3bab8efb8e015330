"""Figures 4 to 7 of the paper and two more, over the runs of the semi-synthetic experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from estimator.network.network import Network
from replay.experiments import published
from replay.experiments.report import Plot
from replay.experiments.semi_synthetic.scores import COURSE_DAYS, ONSET, RunScores, since_change
from replay.experiments.series.filtering import Series, Trace
from replay.scores import pit_histogram, update_magnitudes
from replay.scores.intervals import Mask
from replay.simulated.semi_synthetic import PERIOD, Truth

COLOURS = ("#0b5c8a", "#c2571a", "#3d8b4f", "#8a3b8f", "#a8841a", "#4a5a6a", "#b3324b", "#1f9aa0", "#767676")
_DASHES = ("solid", "dash")
_DAYS_BEFORE_EXAMPLE = 30


def transfer_errors_over_time(scores: Mapping[str, Sequence[RunScores]], network: Network) -> Plot:
    """Fig. 4."""
    channels = [name for name in published.CHANNELS if name in network.inputs]
    figure = make_subplots(1, len(channels), subplot_titles=[published.CHANNELS[name] for name in channels])
    for place, (label, runs) in enumerate(scores.items()):
        mean = np.mean([run.h2_course for run in runs], axis=0)
        for column, name in enumerate(channels, start=1):
            line = go.Scatter(
                x=COURSE_DAYS * np.arange(1, len(mean) + 1),
                y=mean[:, network.inputs.index(name)],
                name=label,
                legendgroup=label,
                showlegend=column == 1,
                line={"color": COLOURS[place % len(COLOURS)], "width": 1.6, "dash": _DASHES[place // len(COLOURS) % 2]},
            )
            figure.add_trace(line, row=1, col=column)
    figure.update_yaxes(type="log").update_xaxes(title="day")
    figure.update_yaxes(title="relative H2 error", col=1).update_layout(legend={"orientation": "h", "y": -0.25})
    return Plot(
        "How far the learned dynamics are from the true ones (Fig. 4)",
        figure,
        "Mean over seeds. A line that falls and stays low has learned the building, one that wanders follows "
        "disturbances. Click a name to hide or show its line.",
        height=520,
    )


def volatility_distribution(trace: Trace, dominated: Mask) -> Plot:
    """Fig. 5."""
    figure = go.Figure()
    edges = np.linspace(np.log(0.01), np.log(25.0), 80)
    centres = (edges[1:] + edges[:-1]) / 2
    log_alpha = np.log(trace.alpha[:, 1])
    for name, rows, colour in _regimes(dominated):
        share, _ = np.histogram(log_alpha[rows], edges, density=True)
        figure.add_trace(go.Bar(x=centres, y=share, name=name, marker_color=colour, opacity=0.6))
        figure.add_vline(x=float(np.median(log_alpha[rows])), line={"color": colour, "dash": "dash"})
    figure.add_vline(x=float(np.log(3.0)), line={"color": "#1b2430", "dash": "dot"})
    figure.update_layout(barmode="overlay", bargap=0, xaxis_title="log alpha", yaxis_title="density")
    return Plot(
        "What alpha says in quiet and in disturbed steps (Fig. 5)",
        figure,
        "First seed, default preset. Dashed: medians. Dotted: log 3, where alpha should stand if nothing but process "
        "noise acts. The further the two apart, the better alpha tells when not to trust the model.",
    )


def update_sizes(traces: Mapping[str, Trace], dominated: Mask) -> Plot:
    """Fig. 6."""
    figure = go.Figure()
    for name, rows, colour in _regimes(dominated):
        boxes: dict[str, list[float]] = {"q1": [], "median": [], "q3": [], "lowerfence": [], "upperfence": []}
        for trace in traces.values():
            sizes = update_magnitudes(trace.theta)
            sizes = sizes[rows & ~np.isnan(sizes)]
            for key, level in zip(boxes, (0.25, 0.5, 0.75, 0.05, 0.95), strict=True):
                boxes[key].append(float(np.quantile(sizes, level)))
        figure.add_trace(go.Box(x=list(traces), name=name, marker_color=colour, **boxes))
    figure.update_layout(boxmode="group", yaxis={"title": "size of the parameter update", "type": "log"})
    return Plot(
        "How much the parameters move per sample (Fig. 6)",
        figure,
        "First seed; boxes are quartiles, whiskers 5 and 95 %. An estimator whose right box stands higher than its "
        "left one learns from disturbances.",
    )


def start_of_an_event(traces: Mapping[str, Trace], series: Series, truth: Truth) -> Plot:
    """Fig. 7."""
    begin = _example(truth.disturbance_dominated)
    rows = slice(max(begin - 24, 1), begin + 48)
    hours = (np.arange(len(series.times))[rows] - begin) * PERIOD / 3600
    figure = go.Figure()
    for place, (label, trace) in enumerate(traces.items()):
        colour = COLOURS[place % len(COLOURS)]
        band = np.concatenate([trace.upper[rows], trace.lower[rows][::-1]])
        figure.add_trace(
            go.Scatter(
                x=np.concatenate([hours, hours[::-1]]),
                y=band,
                fill="toself",
                name=f"{label}, 95 %",
                line={"width": 0},
                fillcolor=colour,
                opacity=0.25,
            )
        )
    measured = {"mode": "markers", "marker": {"size": 4, "color": "#1b2430"}, "name": "measured"}
    figure.add_trace(go.Scatter(x=hours, y=series.outputs[rows, 0], **measured))
    gain = truth.unmeasured_gain[rows] > 0
    for left, right in _spans(gain):
        figure.add_vrect(float(hours[left]), float(hours[right]), fillcolor="#c2571a", opacity=0.08, line_width=0)
    figure.update_layout(xaxis_title="hours since the gain began", yaxis_title="degC")
    return Plot(
        "The intervals when an unmeasured gain begins (Fig. 7)",
        figure,
        "First seed. Shaded: the gain acts. Each band had been published before the dot inside (or outside) it was "
        "measured.",
    )


def onset_coverage(scores: Mapping[str, Sequence[RunScores]]) -> Plot:
    """Coverage step by step after the beginning of an event."""
    figure = go.Figure()
    for place, (label, runs) in enumerate(scores.items()):
        line = {"color": COLOURS[place % len(COLOURS)]}
        onset = np.array([run.onset for run in runs])
        known = np.isfinite(onset).sum(axis=0)
        coverage = np.nansum(onset, axis=0) / np.where(known > 0, known, np.nan)
        figure.add_trace(go.Scatter(x=np.arange(1, ONSET + 1), y=coverage, name=label, line=line))
    figure.add_hline(y=0.95, line={"dash": "dot", "color": "#1b2430"})
    figure.update_layout(xaxis_title="sample since the gain began", yaxis={"title": "coverage", "range": [0, 1]})
    return Plot(
        "How fast the intervals react",
        figure,
        "Share of measurements inside the published interval. Nobody can foresee the first sample; what counts is how "
        "soon the line is back at .95.",
    )


def calibration_histogram(traces: Mapping[str, Trace]) -> Plot:
    """PIT histograms."""
    figure = go.Figure()
    for place, (label, trace) in enumerate(traces.items()):
        shares = pit_histogram(trace.pit)
        centres = (np.arange(len(shares)) + 0.5) / len(shares)
        line = {"color": COLOURS[place % len(COLOURS)], "shape": "hvh"}
        figure.add_trace(go.Scatter(x=centres, y=shares * len(shares), name=label, line=line))
    figure.add_hline(y=1.0, line={"dash": "dot", "color": "#1b2430"})
    figure.update_layout(xaxis_title="where in its forecast the measurement fell", yaxis_title="density")
    return Plot(
        "Calibration of the whole forecast, not of one interval only (PIT)",
        figure,
        "First seed. Flat at 1: the forecast distribution is right throughout. High at both ends: too sure of itself. "
        "A hump: too cautious.",
    )


def _regimes(dominated: Mask) -> list[tuple[str, Mask, str]]:
    """Quiet and disturbed steps with a colour each; in a few days there may be no disturbed one."""
    both = (("quiet", ~dominated, COLOURS[0]), ("disturbed", dominated, COLOURS[1]))
    return [regime for regime in both if regime[1].any()]


def _example(dominated: Mask) -> int:
    """First step of the first event of at least three hours, a month in where there is one."""
    since = np.where(dominated, since_change(dominated), -1)
    begins = np.flatnonzero(since == 3 * 3600 // PERIOD) - 3 * 3600 // PERIOD
    later = begins[begins > _DAYS_BEFORE_EXAMPLE * 86_400 // PERIOD]
    if later.size:
        return int(later[0])
    return int(begins[0]) if begins.size else len(dominated) // 2


def _spans(mask: Mask) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return [(int(a), min(int(b), len(mask) - 1)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
