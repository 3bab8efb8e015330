"""A plan, as people write it, as one row of inputs for every step of a forecast."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from adapters.edge import PLAIN, Edge
from estimator.arrays import Array
from service.errors import DataError
from service.fields.durations import format_duration, parse_duration
from service.fields.words import shown, suggestion
from service.sources.channel import edge_of
from service.zone.aggregation import Span, aggregate
from thermogate.arguments import duration, plain
from thermogate.frames import clock, moments, numbers, pandas
from thermogate.settings import Settings

_ROUNDING = 1e-6


def steps_in(horizon: object, period: float) -> int:
    """How many periods [s] make up `horizon`; DataError for none or no whole number."""
    try:
        length = parse_duration(duration(horizon))
    except ValueError as error:
        raise DataError(f"horizon: {error}") from None
    steps = round(length / period)
    if steps < 1 or abs(steps * period - length) > _ROUNDING:
        near = format_duration(max(1, steps) * period)
        raise DataError(
            f"horizon: {format_duration(length)} is not a whole number of periods of {format_duration(period)}; "
            f"{near} would be"
        )
    return steps


def plan_rows(plan: object, settings: Settings, begin: float, steps: int) -> list[dict[str, float]]:
    """The planned inputs of `steps` steps, of which the first begins at `begin` UTC s, in the network's units.

    A row names only what is planned. DataError with the place of what cannot be used.
    """
    rows: list[dict[str, float]] = [{} for _ in range(steps)]
    for name, values in _planned(plan, settings).items():
        for channel, edge in _meant(name, settings, plan):
            series = _series(name, values, settings, channel, begin, steps)
            for row, raw in zip(rows, series.tolist(), strict=True):
                if not np.isnan(raw):
                    row[channel] = _believed(name, edge, raw, channel, settings)
    return rows


def _planned(plan: object, settings: Settings) -> dict[str, Any]:
    """The columns of a plan by name; those of a DataFrame that cannot be planned are left out."""
    if plan is None:
        return {}
    if isinstance(plan, Mapping):
        return dict(plan)
    pd = pandas()
    if not isinstance(plan, pd.DataFrame):
        raise DataError('the plan must be a DataFrame or a dict such as {"u_heat": 1500.0}, not ' + shown(plan))
    outputs = {name for output in settings.network.measured for name in (output, *settings.source_columns[output])}
    inputs = _names(settings)
    passed_over = (outputs | set(settings.other_columns)) - inputs.keys()
    return {str(name): plan[name] for name in plan.columns if str(name) not in passed_over}


def _names(settings: Settings) -> dict[str, list[tuple[str, Edge | None]]]:
    """What an input can be called in a plan: its column, in the column's unit, or its channel, in the network's. The
    conversion is None for a column that counts energy, which nobody can plan."""
    names: dict[str, list[tuple[str, Edge | None]]] = {}
    for channel in settings.network.inputs:
        table, columns = settings.zone.channels[channel], settings.source_columns[channel]
        if len(columns) == 1:
            edge = edge_of(table, settings.units[channel])
            counts = edge.counter or table.aggregate == "energy"
            names.setdefault(columns[0], []).append((channel, None if counts else edge))
    for channel in settings.network.inputs:
        names.setdefault(channel, [(channel, PLAIN)])
    return names


def _meant(name: str, settings: Settings, plan: object) -> list[tuple[str, Edge]]:
    names = _names(settings)
    if name not in names:
        units = [f"{channel} [{settings.units[channel]}]" for channel in settings.network.inputs]
        close = suggestion(name, names, "").partition("; ")[2]
        raise DataError(
            f"the plan has {shown(name)}, which is no input of the model; its inputs are {', '.join(units)}"
            + (f"; {close}" if close else "")
        )
    found = []
    for channel, edge in names[name]:
        if edge is None:
            raise DataError(
                f"the plan has {shown(name)}, which counts energy; plan {channel} in {settings.units[channel]} instead"
            )
        found.append((channel, edge))
    return found


def _series(name: str, values: Any, settings: Settings, channel: str, begin: float, steps: int) -> Array:
    """The planned values (steps,) of one column, in its own unit; NaN before the first."""
    if isinstance(values, np.generic | np.ndarray) and values.ndim == 0:
        values = plain(values)
    if isinstance(values, int | float) and not isinstance(values, bool):
        return np.full(steps, float(values))
    pd = pandas()
    if isinstance(values, pd.Series) and isinstance(values.index, pd.DatetimeIndex):
        return _timed(name, values.to_frame(name), settings, channel, begin, steps)
    if isinstance(values, str | bytes | Mapping) or not isinstance(values, Sequence | np.ndarray | pd.Series):
        raise DataError(f"the plan's {shown(name)} must be a number or one number for every step, not {shown(values)}")
    found = numbers(pd.DataFrame({name: list(values)}), name, "the plan")
    if len(found) != steps:
        period = settings.zone.period
        raise DataError(
            f"the plan has {len(found)} values of {shown(name)}, but the horizon has {steps} steps of "
            f'{format_duration(period)}; give {steps} values, or horizon="{format_duration(len(found) * period)}"'
        )
    return _held(found)


def _timed(name: str, frame: Any, settings: Settings, channel: str, begin: float, steps: int) -> Array:
    """Values with times on the grid, by the rule of the channel; between them the last one holds."""
    period = settings.zone.period
    times, values = clock(frame, settings.tz, "the plan").seconds, numbers(frame, name, "the plan")
    order = np.argsort(times, kind="stable")
    order = order[np.isfinite(times[order]) & ~np.isnan(values[order])]
    times, values = times[order], values[order]
    places = np.floor((times - begin) / period).astype(np.int64)
    if len(places) and (places[-1] < 0 or places[0] >= steps):
        first, last = moments([begin, begin + steps * period], settings.tz)
        raise DataError(
            f"the plan's {shown(name)} has no value between {first} and {last}, the time that is forecast; give the "
            "inputs that are planned for that time"
        )
    rule, series = aggregate(settings.zone.channels[channel].aggregate), np.full(steps, np.nan)
    for place in np.unique(places[(places >= 0) & (places < steps)]).tolist():
        rows = np.flatnonzero(places == place)[rule.used]
        since = begin + place * period
        series[place] = rule.combine(Span(times[rows].tolist(), values[rows].tolist(), since, since + period))
    earlier = values[places < 0]
    if len(earlier) and np.isnan(series[0]):
        series[0] = earlier[-1]
    return _held(series)


def _held(values: Array) -> Array:
    """`values` (n,) with every NaN replaced by the value before it."""
    last = np.maximum.accumulate(np.where(np.isnan(values), -1, np.arange(len(values))))
    return np.where(last < 0, np.nan, values[np.maximum(last, 0)])


def _believed(name: str, edge: Edge, raw: float, channel: str, settings: Settings) -> float:
    value = edge.value(raw)
    lower, upper = settings.zone.channels[channel].valid or (-np.inf, np.inf)
    if not (np.isfinite(value) and lower <= value <= upper):
        unit = settings.units[channel]
        raise DataError(
            f"the plan's {shown(name)} has {raw:g}, which is {value:g} {unit}; {channel} is believed from {lower:g} to "
            f"{upper:g} {unit}"
        )
    return value
