"""Figures of a model, drawn by matplotlib from tables and records: each function draws one panel."""

from collections.abc import Callable, Mapping
from functools import cache
from io import BytesIO
from typing import Any

import numpy as np

from replay.recorded.trace import Trace
from thermogate.frames import Frame, moments

_INK, _BLUE, _WARM, _GREEN = "#1b2430", "#0b5c8a", "#c2571a", "#2e7d4f"
_PANEL = (7.0, 3.6)
"""Inches."""

Draw = Callable[[Any], None]
"""Draws into a figure."""


def drawn(panels: Mapping[str, Draw]) -> Any:
    """A matplotlib Figure of `panels` by title, two in a row; ImportError where matplotlib is not installed."""
    rows, columns = -(-len(panels) // 2), min(2, len(panels))
    figure = _figure_class()(figsize=(_PANEL[0] * columns, _PANEL[1] * rows), layout="constrained")
    parts = np.atleast_1d(figure.subfigures(rows, columns)).ravel()
    for part, (title, draw) in zip(parts, panels.items(), strict=False):
        part.suptitle(title)
        draw(part)
    return figure


@cache
def _figure_class() -> Any:
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise ImportError(
            'matplotlib is not installed; install it with: pip install "thermogate[pandas,plot]"'
        ) from None

    class Shown(Figure):
        """A figure that a notebook shows once, whether or not pyplot was imported."""

        def _repr_png_(self) -> bytes:
            content = BytesIO()
            self.savefig(content, format="png")
            return content.getvalue()

    return Shown


def forecast(fan: Frame, trace: Trace, output: str, tz: str) -> Draw:
    """`fan`, a forecast of `output` with intervals of 50 and 95 %, after as long a stretch of what was measured."""

    def draw(figure: Any) -> None:
        axes = figure.subplots()
        measured = [row for row in trace.rows[-len(fan) :] if row.time < fan.index[0].timestamp()]
        for level, alpha in (("0.95", 0.18), ("0.5", 0.3)):
            lower, upper = fan[f"lower_{level}"], fan[f"upper_{level}"]
            label = f"{100 * float(level):g} % interval"
            axes.fill_between(fan.index, lower, upper, color=_BLUE, alpha=alpha, linewidth=0, label=label)
        axes.plot(fan.index, fan["median"], color=_BLUE, label="forecast")
        past = moments([row.time for row in measured], tz)
        axes.plot(past, [row.y for row in measured], color=_INK, label="measured")
        _setpoint(axes, past, [row.setpoint for row in measured])
        _finish(axes, f"time ({tz})", f"{output} [°C]", past.tz)

    return draw


def history(trace: Trace, tz: str) -> Draw:
    """What was measured, in the intervals that stood before it was, over the inputs of each unit."""

    def draw(figure: Any) -> None:
        network, times = trace.network, moments([row.time for row in trace.rows], tz)
        units = list(dict.fromkeys(network.channel_unit(channel) for channel in network.inputs))
        first, *others = figure.subplots(1 + len(units), sharex=True, height_ratios=[2, *[1] * len(units)])
        lower, upper, y, setpoint = (
            np.array([getattr(row, name) for row in trace.rows]) for name in ("lower", "upper", "y", "setpoint")
        )
        label = f"{100 * trace.level:g} % interval,\none step ahead"
        first.fill_between(times, lower, upper, color=_BLUE, alpha=0.25, linewidth=0, label=label)
        first.plot(times, y, color=_INK, linewidth=0.8, label="measured")
        _setpoint(first, times, setpoint)
        low, high = np.nanpercentile(y, [0.1, 99.9])
        # One wild band does not flatten the rest.
        first.set_ylim(low - 1.0, high + 1.0)
        _finish(first, "", f"{network.measured[0]} [°C]", times.tz)
        for axes, unit in zip(others, units, strict=True):
            for place, channel in enumerate(network.inputs):
                if network.channel_unit(channel) == unit:
                    axes.plot(times, trace.inputs[:, place], drawstyle="steps-post", linewidth=0.8, label=channel)
            _finish(axes, f"time ({tz})" if unit == units[-1] else "", _unit(unit), times.tz)

    return draw


def warms(trace: Trace) -> bool:
    """Whether any heat besides the heating is known."""
    return trace.room is not None and max(np.nanmax(trace.room.people), np.nanmax(trace.room.sun)) > 0.0


def profile(trace: Trace, tz: str) -> Draw:
    """Heat besides the heating by the hour of the day: sun, and people and appliances."""

    def draw(figure: Any) -> None:
        axes, hours = figure.subplots(), np.arange(24) + 0.5
        assert trace.room is not None
        people, sun = (np.nan_to_num(np.array(heat)) for heat in (trace.room.people, trace.room.sun))
        axes.bar(hours, people, width=0.9, color=_BLUE, label="people and appliances")
        axes.bar(hours, sun, bottom=people, width=0.9, color=_WARM, label="sun")
        axes.set_xticks(range(0, 25, 3))
        _finish(axes, f"hour of the day ({tz})", "heat besides the heating [W]")

    return draw


def parameters(table: Frame) -> Draw:
    """The 95 % interval and the median of each learned parameter between the bounds of its prior."""

    def draw(figure: Any) -> None:
        axes, learned = figure.subplots(), table[table["free"]].iloc[::-1]
        low = np.log(learned["prior_lower"])
        width = np.log(learned["prior_upper"]) - low
        left, middle, right = ((np.log(learned[name]) - low) / width for name in ("q0.025", "q0.5", "q0.975"))
        axes.errorbar(middle, learned.index, xerr=[middle - left, right - middle], fmt="o", color=_BLUE, capsize=3)
        axes.set_yticks(range(len(learned)), [f"{name} [{row.unit}]" for name, row in learned.iterrows()])
        for place, (value, x) in enumerate(zip(learned["q0.5"], middle, strict=True)):
            axes.annotate(f"{value:.3g}", (x, place), textcoords="offset points", xytext=(0, 5), ha="center")
        axes.set_xlim(-0.02, 1.02)
        axes.set_ylim(-0.6, len(learned) - 0.4)
        axes.set_xticks([0, 1], ["lower bound", "upper bound"])
        axes.set_xlabel("95 % interval between the prior's bounds, logarithmic")

    return draw


def _setpoint(axes: Any, times: Any, setpoint: Any) -> None:
    if np.isfinite(np.asarray(setpoint, dtype=np.float64)).any():
        axes.plot(times, setpoint, color=_GREEN, linestyle="--", drawstyle="steps-post", label="set-point")


def _finish(axes: Any, below: str, beside: str, zone: Any = None) -> None:
    """Label the axes; those of times show the clock of `zone`."""
    axes.set_xlabel(below)
    axes.set_ylabel(beside)
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize="small")
    if zone is not None:
        from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

        locator = AutoDateLocator(tz=zone)
        axes.xaxis.set_major_locator(locator)
        axes.xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=zone))


def _unit(unit: str) -> str:
    return f"[{unit.replace('degC', '°C').replace('W/m2', 'W/m²')}]"
