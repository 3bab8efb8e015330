"""The plots of a zone's report."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from estimator.arrays import Array
from replay.localtime import HOUR, Seconds
from replay.recorded.trace import Trace
from replay.reports.kit.report import Plot
from replay.reports.residuals import Diagnostics
from replay.scores.intervals import pit_histogram
from service.forecast.answers import Room

_INK, _BLUE, _BAND, _WARM = "#1b2430", "#0b5c8a", "rgba(11,92,138,.22)", "#c2571a"
_GREEN = "#2e7d4f"
_COLOURS = (_WARM, "#3d8b4f", "#8a3b8f", "#a8841a", "#b3324b", "#1f9aa0", "#767676")
_SYMBOLS = {"degC": "°C", "W/m2": "W/m²"}
_DRAWN = 2500
"""Points of a line at most: more are not to be seen and make the page heavy."""
_BINS = 20
_RARE, _WILD = 0.001, 0.05
"""Shares of a line and of a band that may lie beyond either end of a chart."""
_SHEET = 860
"""Pixels of a plot that a printed sheet holds with its title and its note."""
_FANS = 30
"""Days of fans that are drawn, the newest."""


def thinned(count: int) -> int:
    """Of `count` points one in so many is drawn."""
    return -(-count // _DRAWN)


def record(trace: Trace) -> Plot:
    """Measured temperature in its published band, and the inputs below."""
    inputs = trace.network.inputs
    units = list(dict.fromkeys(trace.network.channel_unit(channel) for channel in inputs))
    figure = make_subplots(
        rows=1 + len(units),
        shared_xaxes=True,
        vertical_spacing=0.05,
        row_heights=[0.5, *[0.5 / len(units)] * len(units)],
    )
    y, lower, upper = (np.array([getattr(row, name) for row in trace.rows]) for name in ("y", "lower", "upper"))
    times = np.array([row.time for row in trace.rows], dtype=np.int64)
    every = thinned(len(times))
    edges = _with_gaps(trace, times[::every], trace.period * every, y[::every], lower[::every], upper[::every])
    stamps, (y, lower, upper) = edges
    _band(figure, stamps, lower, upper, f"{100 * trace.level:g} % interval", row=1)
    figure.add_trace(_line(stamps, y, trace.network.measured[0], _INK), row=1, col=1)
    setpoint = np.array([row.setpoint for row in trace.rows])[::every]
    if np.isfinite(setpoint).any():
        stamps, (meant,) = _with_gaps(trace, times[::every], trace.period * every, setpoint)
        line = _line(stamps, meant, "set-point", _GREEN)
        figure.add_trace(line.update(line_shape="hv", line_dash="dash"), row=1, col=1)
    figure.update_yaxes(range=_legible((y, setpoint), (lower, upper)), row=1, col=1)
    for place, channel in enumerate(inputs):
        stamps, (values,) = _with_gaps(trace, times[::every], trace.period * every, trace.inputs[::every, place])
        row = 2 + units.index(trace.network.channel_unit(channel))
        line = _line(stamps, values, channel, _COLOURS[place % len(_COLOURS)])
        figure.add_trace(line.update(line_shape="hv"), row=row, col=1)
    for row, unit in enumerate(["degC", *units], start=1):
        figure.update_yaxes(title_text=_SYMBOLS.get(unit, unit), row=row, col=1)
    figure.update_xaxes(title_text=trace.clock, row=1 + len(units), col=1)
    return Plot("record", figure, height=300 + 130 * len(units))


def fans(trace: Trace) -> Plot:
    """Forecasts of whole days against what came."""
    figure, drawn = go.Figure(), trace.fans[-_FANS:]
    first, last = drawn[0].times[0], drawn[-1].times[-1]
    times = np.concatenate([fan.times for fan in drawn])
    values = np.concatenate([fan.quantiles for fan in drawn]).T
    every = thinned(len(times))
    stamps, (lower, median, upper) = _with_gaps(trace, times[::every], trace.period * every, *values[:, ::every])
    _band(figure, stamps, lower, upper, "95 % of the forecast")
    figure.add_trace(_line(stamps, median, "forecast", _BLUE))
    rows = [row for row in trace.rows if first <= row.time <= last][::every]
    moments = np.array([row.time for row in rows], dtype=np.int64)
    stamps, (y,) = _with_gaps(trace, moments, trace.period * every, np.array([row.y for row in rows]))
    figure.add_trace(_line(stamps, y, "measured", _INK))
    figure.update_layout(yaxis_title="°C", xaxis_title=trace.clock, yaxis_range=_legible((y, median), (lower, upper)))
    return Plot("fans", figure)


def heat(trace: Trace, room: Room) -> Plot:
    """Heat besides the heating, by the hour of the day."""
    figure, hours = go.Figure(), [f"{hour}:30" for hour in range(24)]
    for name, values, colour in (("people and appliances", room.people, _BLUE), ("sun", room.sun, _WARM)):
        figure.add_trace(go.Bar(x=hours, y=values, name=name, marker_color=colour))
    figure.update_layout(barmode="stack", bargap=0.1, yaxis_title="W", xaxis_title=trace.clock)
    return Plot("heat", figure, height=280)


def gain(trace: Trace) -> Plot:
    """Unmeasured heat over time."""
    figure = go.Figure()
    times = np.array([row.time for row in trace.rows], dtype=np.int64)
    every = thinned(len(times))
    columns = trace.gain[::every].T
    stamps, (lower, median, upper) = _with_gaps(trace, times[::every], trace.period * every, *columns)
    _band(figure, stamps, lower, upper, "95 % interval")
    figure.add_trace(_line(stamps, median, "median", _WARM))
    figure.update_layout(yaxis_title="W", xaxis_title=trace.clock, yaxis_range=_legible((median,), (lower, upper)))
    return Plot("gain", figure)


def parameters(trace: Trace) -> Plot:
    """Every learned parameter and the heat loss over time, with their bounds."""
    learned = [place for place, parameter in enumerate(trace.network.parameters) if parameter.free]
    named = [f"{trace.network.parameters[place].name} [{trace.network.parameters[place].unit}]" for place in learned]
    rows = -(-(len(learned) + 1) // 2)
    figure = make_subplots(
        rows=rows, cols=2, subplot_titles=[*named, "heat loss to all sides [W/K]"], vertical_spacing=0.35 / max(rows, 2)
    )
    stamps = _stamps(trace, trace.looks)
    for panel, place in enumerate([*learned, None]):
        row, col = panel // 2 + 1, panel % 2 + 1
        values = trace.heat_loss if place is None else trace.parameters[:, place]
        _band(figure, stamps, values[:, 0], values[:, 2], "95 % interval", row=row, col=col, legend=panel == 0)
        line = _line(stamps, values[:, 1], "median", _BLUE)
        figure.add_trace(line.update(showlegend=panel == 0), row=row, col=col)
        if place is not None:
            parameter = trace.network.parameters[place]
            for bound in (parameter.lower, parameter.upper):
                _level(figure, bound, 1.5, row=row, col=col)
        figure.update_yaxes(type="log", row=row, col=col)
        if place is None:
            low, median, high = (np.log10(column) for column in values.T)
            figure.update_yaxes(range=_legible((median,), (low, high)), row=row, col=col)
    return Plot("parameters-over-time", figure, height=min(60 + 210 * rows, _SHEET))


def pit(found: Diagnostics) -> Plot:
    """Where measurements fell in their forecasts."""
    figure = go.Figure()
    centres = (np.arange(_BINS) + 0.5) / _BINS
    figure.add_trace(go.Bar(x=centres, y=pit_histogram(found.pit, _BINS), marker_color=_BLUE, showlegend=False))
    _level(figure, 1.0 / _BINS, 2)
    figure.update_layout(
        xaxis_title="place of the measurement in its forecast", yaxis_title="share of the forecasts", bargap=0.05
    )
    return Plot("pit", figure, height=320)


def memory(found: Diagnostics) -> Plot:
    """Autocorrelation of the residuals."""
    figure = go.Figure()
    hours = found.lags / HOUR
    figure.add_trace(go.Bar(x=hours, y=found.autocorrelation, marker_color=_BLUE, showlegend=False))
    _white(figure, found)
    figure.update_layout(xaxis_title="lag [h]", yaxis_title="autocorrelation")
    return Plot("memory", figure, height=320)


def against_inputs(found: Diagnostics, period: float) -> Plot:
    """Correlation of the residuals with every input."""
    figure = go.Figure()
    for place, (channel, values) in enumerate(found.against_inputs.items()):
        hours = np.arange(len(values)) * period / HOUR
        figure.add_trace(go.Scatter(x=hours, y=values, name=channel, line={"color": _COLOURS[place % len(_COLOURS)]}))
    _white(figure, found)
    figure.update_layout(xaxis_title="time since the input [h]", yaxis_title="correlation of the error")
    return Plot("against-inputs", figure, height=320)


def _white(figure: go.Figure, found: Diagnostics) -> None:
    for bound in (-found.band, found.band):
        _level(figure, bound, 1)


def _level(figure: go.Figure, y: float, width: float, **place: int) -> None:
    """A dashed line across a panel. `add_hline` draws the same, and takes five times as long."""
    line = {"color": _WARM, "width": width, "dash": "dash"}
    figure.add_shape(type="line", x0=0, x1=1, xref="x domain", y0=y, y1=y, yref="y", line=line, **place)


def _with_gaps(trace: Trace, times: Seconds, period: float, *columns: Array) -> tuple[Array, list[Array]]:
    """Stamps of the site's clock and columns; where more than a period lies between two rows, a NaN ends the line."""
    after = np.flatnonzero(np.diff(times) > 1.5 * period) + 1
    stamps = np.insert(times, after, times[after] - 1) if len(after) else times
    return _stamps(trace, stamps), [np.insert(column, after, np.nan) if len(after) else column for column in columns]


def _stamps(trace: Trace, times: Seconds) -> Array:
    return trace.local(times).astype("datetime64[s]").astype("datetime64[ms]")


def _legible(lines: Sequence[Array], bands: Sequence[Array]) -> list[float] | None:
    """A range that shows most of the lines whole, and as much of the bands as leaves them legible: neither a first day
    nor one wild band flattens a chart. None where there is nothing to show."""
    known = np.concatenate([line[np.isfinite(line)] for line in lines])
    if not len(known):
        return None
    low, high = np.quantile(known, [_RARE, 1.0 - _RARE]).tolist()
    room = max(high - low, 1e-3)
    lower, upper = (
        float(np.quantile(finite, level)) if len(finite := band[np.isfinite(band)]) else middle
        for band, level, middle in zip(bands, (_WILD, 1.0 - _WILD), (low, high), strict=True)
    )
    low, high = max(min(low, lower), low - room), min(max(high, upper), high + room)
    return [low - 0.05 * room, high + 0.05 * room]


def _line(stamps: Array, values: Array, name: str, colour: str) -> go.Scatter:
    return go.Scatter(x=stamps, y=values, name=name, mode="lines", line={"color": colour, "width": 1.3})


def _band(
    figure: go.Figure,
    stamps: Array,
    lower: Array,
    upper: Array,
    name: str,
    row: int | None = None,
    col: int = 1,
    legend: bool = True,
) -> None:
    """A filled band; a gap splits it, for a filled outline would close over it."""
    known = np.isfinite(lower) & np.isfinite(upper)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
    place = {} if row is None else {"row": row, "col": col}
    for piece, (begin, end) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        outline: Sequence[Array] = (stamps[begin:end], stamps[begin:end][::-1])
        band = go.Scatter(
            x=np.concatenate(outline),
            y=np.concatenate([upper[begin:end], lower[begin:end][::-1]]),
            name=name,
            legendgroup=name,
            showlegend=legend and piece == 0,
            fill="toself",
            fillcolor=_BAND,
            line={"width": 0},
            hoverinfo="skip",
        )
        figure.add_trace(band, **place)
