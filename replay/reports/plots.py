"""The plots of a zone's report."""

from collections.abc import Sequence

import numpy as np

from estimator.arrays import Array
from replay.localtime import HOUR, Seconds
from replay.recorded.trace import Trace
from replay.reports.kit.chart import Band, Bars, Chart, Level, Line, Mark, Panel
from replay.reports.kit.report import Plot
from replay.reports.residuals import Diagnostics
from replay.scores.intervals import pit_histogram
from service.forecast.answers import Room

_COLOURS = ("warm", "green", "violet", "ochre", "red", "teal", "grey")
"""Of inputs."""
_SYMBOLS = {"degC": "°C", "W/m2": "W/m²"}
_DRAWN = 2500
"""Points of a line at most: more are not to be seen and make the page heavy."""
_BINS = 20
_RARE, _WILD = 0.001, 0.05
"""Shares of a line and of a band that may lie beyond either end of a chart."""
_HALF = 150
"""Pixels of a panel beside others."""
_FANS = 30
"""Days of fans that are drawn, the newest."""


def thinned(count: int) -> int:
    """Of `count` points one in so many is drawn."""
    return -(-count // _DRAWN)


def record(trace: Trace) -> Plot:
    y, lower, upper, setpoint = (
        np.array([getattr(row, name) for row in trace.rows]) for name in ("y", "lower", "upper", "setpoint")
    )
    times = np.array([row.time for row in trace.rows], dtype=np.int64)
    x, (y, lower, upper, setpoint, *inputs) = _drawn(trace, times, y, lower, upper, setpoint, *trace.inputs.T)
    marks: list[Mark] = [
        Band(f"{100 * trace.level:g} % interval", x, lower, upper),
        Line(trace.network.measured[0], "ink", x, y),
    ]
    if np.isfinite(setpoint).any():
        marks.append(Line("set-point", "blue", x, setpoint, step=True, dashed=True))
    by_unit: dict[str, list[Line]] = {}
    for place, (channel, values) in enumerate(zip(trace.network.inputs, inputs, strict=True)):
        line = Line(channel, _COLOURS[place % len(_COLOURS)], x, values, step=True)
        by_unit.setdefault(trace.network.channel_unit(channel), []).append(line)
    panels = [Panel(marks, "°C", range=_legible((y, setpoint), (lower, upper)))]
    panels += [Panel(lines, _SYMBOLS.get(unit, unit), 120) for unit, lines in by_unit.items()]
    return Plot("record", Chart(panels, trace.clock, dated=True))


def fans(trace: Trace) -> Plot:
    """Forecasts of whole days against what came."""
    drawn = trace.fans[-_FANS:]
    first, last = drawn[0].times[0], drawn[-1].times[-1]
    times = np.concatenate([fan.times for fan in drawn])
    x, (lower, median, upper) = _drawn(trace, times, *np.concatenate([fan.quantiles for fan in drawn]).T)
    rows = [row for row in trace.rows if first <= row.time <= last]
    measured, (y,) = _drawn(trace, np.array([row.time for row in rows], dtype=np.int64), np.array([r.y for r in rows]))
    marks = Band("95 % of the forecast", x, lower, upper), Line("forecast", "blue", x, median)
    panel = Panel((*marks, Line("measured", "ink", measured, y)), "°C", range=_legible((y, median), (lower, upper)))
    return Plot("fans", Chart([panel], trace.clock, dated=True))


def heat(trace: Trace, room: Room) -> Plot:
    hours = np.arange(24, dtype=np.float64) + 0.5
    people, sun = np.array(room.people), np.array(room.sun)
    marks = (
        Bars("people and appliances", "blue", hours, people, 0.9, np.zeros(24)),
        Bars("sun", "warm", hours, sun, 0.9, np.nan_to_num(people)),
    )
    labels = [(float(hour), f"{hour}:00") for hour in range(0, 25, 3)]
    return Plot("heat", Chart([Panel(marks, "W", 200)], trace.clock, labels=labels))


def gain(trace: Trace) -> Plot:
    times = np.array([row.time for row in trace.rows], dtype=np.int64)
    x, (lower, median, upper) = _drawn(trace, times, *trace.gain.T)
    marks = Band("95 % interval", x, lower, upper), Line("median", "warm", x, median)
    return Plot("gain", Chart([Panel(marks, "W", range=_legible((median,), (lower, upper)))], trace.clock, dated=True))


def parameters(trace: Trace) -> Plot:
    """Every learned parameter and the heat loss over time, with their bounds."""
    x = trace.local(trace.looks).astype(np.float64)
    panels = []
    for place, parameter in enumerate(trace.network.parameters):
        if parameter.free:
            bounds = Level(parameter.lower), Level(parameter.upper)
            lines = _learned(x, trace.parameters[:, place])
            panels.append(Panel((*lines, *bounds), f"[{parameter.unit}]", _HALF, log=True, title=parameter.name))
    low, median, high = (np.log10(column) for column in trace.heat_loss.T)
    shown = _legible((median,), (low, high))
    wide = None if shown is None else (10.0 ** shown[0], 10.0 ** shown[1])
    title = "heat loss to all sides"
    panels.append(Panel(_learned(x, trace.heat_loss), "[W/K]", _HALF, wide, log=True, title=title))
    return Plot("parameters-over-time", Chart(panels, trace.clock, dated=True, columns=2))


def _learned(x: Array, values: Array) -> tuple[Band, Line]:
    return Band("95 % interval", x, values[:, 0], values[:, 2]), Line("median", "blue", x, values[:, 1])


def pit(found: Diagnostics) -> Plot:
    """Where measurements fell in their forecasts."""
    centres = (np.arange(_BINS) + 0.5) / _BINS
    bars = Bars("", "blue", centres, pit_histogram(found.pit, _BINS), 0.95 / _BINS, np.zeros(_BINS))
    panel = Panel((bars, Level(1.0 / _BINS)), "share of the forecasts", 220)
    return Plot("pit", Chart([panel], "place of the measurement in its forecast"))


def memory(found: Diagnostics) -> Plot:
    hours = found.lags / HOUR
    bars = Bars("", "blue", hours, found.autocorrelation, 0.8 * hours[0], np.zeros(len(hours)))
    return Plot("memory", Chart([Panel((bars, *_white(found)), "autocorrelation", 220)], "lag [h]"))


def against_inputs(found: Diagnostics, period: float) -> Plot:
    lines = [
        Line(channel, _COLOURS[place % len(_COLOURS)], np.arange(len(values)) * period / HOUR, values)
        for place, (channel, values) in enumerate(found.against_inputs.items())
    ]
    panel = Panel((*lines, *_white(found)), "correlation of the error", 220)
    return Plot("against-inputs", Chart([panel], "time since the input [h]"))


def _white(found: Diagnostics) -> tuple[Level, Level]:
    return Level(-found.band), Level(found.band)


def _drawn(trace: Trace, times: Seconds, *columns: Array) -> tuple[Array, list[Array]]:
    """Times of the site's clock and columns, thinned; where rows are missing, a NaN ends the line."""
    every = thinned(len(times))
    times, columns = times[::every], tuple(column[::every] for column in columns)
    after = np.flatnonzero(np.diff(times) > 1.5 * trace.period * every) + 1
    stamps = trace.local(np.insert(times, after, times[after] - 1)).astype(np.float64)
    return stamps, [np.insert(column, after, np.nan) for column in columns]


def _legible(lines: Sequence[Array], bands: Sequence[Array]) -> tuple[float, float] | None:
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
    return low - 0.05 * room, high + 0.05 * room
