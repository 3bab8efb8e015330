"""The figures of the control report."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from replay.experiments.control.cases import STEPS_A_DAY, WARMEST, disturbed_steps
from replay.experiments.control.outcome import Outcome
from replay.experiments.control.runs import EKF, LEAST_SQUARES, PERFECT, THERMOGATE, THERMOSTAT, UNTRUSTING
from replay.experiments.report import Plot
from replay.localtime import DAY

COLOURS = {
    THERMOSTAT: "#767676",
    LEAST_SQUARES: "#a8841a",
    EKF: "#3d8b4f",
    UNTRUSTING: "#e0a08a",
    THERMOGATE: "#c2571a",
    PERFECT: "#0b5c8a",
}
_SHOWN = 7
"""Days of a figure over time."""


def cost_and_discomfort(outcome: Outcome) -> Plot:
    """Every run of the first seed; settings of one controller are joined."""
    figure = go.Figure()
    seen = next(iter(outcome.seen.values()))
    for controller in outcome.controllers:
        points = sorted((one.discomfort, one.cost) for one in seen.swept[controller])
        figure.add_trace(
            go.Scatter(
                x=[at for at, _ in points],
                y=[cost for _, cost in points],
                name=controller,
                mode="markers",
                marker={"size": 13 if controller == THERMOGATE else 9, "color": COLOURS[controller]},
            )
        )
    figure.update_layout(xaxis={"title": "discomfort, K h", "type": "log"}, yaxis_title="cost")
    return Plot(
        f"{outcome.name}: cost and discomfort",
        figure,
        "First seed; lower and further to the left is better. A controller with several points was run with several "
        "comfort margins.",
    )


def a_week(outcome: Outcome) -> Plot:
    """Temperature and heating of the first room in a week under control, of the first seed."""
    scene, seen = outcome.scene, next(iter(outcome.seen.values()))
    days = min(_SHOWN, scene.controlled)
    # The second week, if there is one: by then everybody has settled.
    begin = scene.controlled_from + (days * STEPS_A_DAY if scene.controlled >= 2 * days else 0)
    rows = slice(begin, begin + days * STEPS_A_DAY)
    figure = make_subplots(3, 1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.5, 0.3, 0.2])
    room, life = scene.of.rooms[0], scene.life()
    for controller in (THERMOSTAT, THERMOGATE, PERFECT):
        lived = seen.lives[controller]
        at = (lived.local[rows] - lived.local[scene.controlled_from]) / DAY
        line, group = {"color": COLOURS[controller], "width": 1.5}, controller
        for row, values in ((1, lived.air[rows, 0]), (2, _hourly(lived.heating[rows, 0]) / 1000.0)):
            trace = go.Scatter(x=at, y=values, name=controller, line=line, legendgroup=group, showlegend=row == 1)
            figure.add_trace(trace, row, 1)
    lived = seen.lives[THERMOGATE]
    at = (lived.local[rows] - lived.local[scene.controlled_from]) / DAY
    low = [life.set_points(local)[0] for local in lived.local[rows]]
    dotted = {"dash": "dot", "color": "#1b2430", "width": 1}
    figure.add_trace(go.Scatter(x=at, y=low, name="comfort band", line=dotted), 1, 1)
    figure.add_trace(go.Scatter(x=at, y=[WARMEST] * len(at), line=dotted, showlegend=False), 1, 1)
    for name, marks, colour in (
        ("planned", lived.planned[rows, 0], COLOURS[THERMOGATE]),
        ("disturbed", disturbed_steps(scene)[rows], "#b3324b"),
    ):
        filled = {"name": name, "line": {"color": colour, "width": 1}, "fill": "tozeroy"}
        figure.add_trace(go.Scatter(x=at, y=marks.astype(float), **filled), 3, 1)
    figure.update_yaxes(title="degC", row=1, col=1)
    figure.update_yaxes(title="kW", row=2, col=1)
    figure.update_xaxes(title="controlled days", row=3, col=1)
    return Plot(
        f"{outcome.name}: {days} days of the room '{room.name}'",
        figure,
        "First seed. Heating is the mean over an hour. Below: where Thermogate's plan heats, and where a disturbance "
        "acts.",
        height=620,
    )


def _hourly(values: np.ndarray) -> np.ndarray:
    """Running means of an hour."""
    return np.convolve(values, np.full(12, 1.0 / 12.0), mode="same")
