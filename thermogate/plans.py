"""A plan, as people write it in a notebook, in the grammar of plans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from adapters.edge import PLAIN, Edge
from estimator.arrays import Array
from service.config.fitting import limits_of
from service.errors import DataError, PlanError
from service.fields.durations import format_duration, parse_duration
from service.fields.words import shown, suggestion
from service.forecast.plan import Grid, Inputs, Timed, Values, check
from service.sources.channel import edge_of
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


def planned_inputs(plan: object, settings: Settings, begin: float, steps: int) -> Inputs:
    """What `plan` says of the inputs over `steps` steps from `begin`, UTC s, on, in the network's units. DataError with
    the place of what cannot be used."""
    found, grid = {}, Grid(begin, settings.zone.period, steps)
    for name, given in _columns(plan, settings).items():
        for channel, edge in _meant(name, settings, plan):
            values = _in_unit(_values(name, given, settings, grid), edge)
            limits = {channel: limits_of(settings.zone.channels[channel], settings.units[channel])}
            try:
                check(values, channel, settings.network, limits, grid)
            except PlanError as error:
                raise DataError(f"the plan's {shown(name)} {error}") from None
            found[channel] = values
    return found


def _columns(plan: object, settings: Settings) -> dict[str, Any]:
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


def _values(name: str, given: Any, settings: Settings, grid: Grid) -> float | Array | Timed:
    """What is planned in one column, in its own unit."""
    if isinstance(given, np.generic | np.ndarray) and given.ndim == 0:
        given = plain(given)
    if isinstance(given, int | float) and not isinstance(given, bool):
        return float(given)
    pd = pandas()
    if isinstance(given, pd.Series) and isinstance(given.index, pd.DatetimeIndex):
        return _timed(name, given.to_frame(name), settings, grid)
    if isinstance(given, str | bytes | Mapping) or not isinstance(given, Sequence | np.ndarray | pd.Series):
        raise DataError(f"the plan's {shown(name)} must be a number or one number for every step, not {shown(given)}")
    found = numbers(pd.DataFrame({name: list(given)}), name, "the plan")
    # What is not filled in is as before.
    last = np.maximum.accumulate(np.where(np.isnan(found), -1, np.arange(len(found))))
    return np.where(last < 0, np.nan, found[np.maximum(last, 0)])


def _timed(name: str, frame: Any, settings: Settings, grid: Grid) -> Timed:
    times, values = clock(frame, settings.tz, "the plan").seconds, numbers(frame, name, "the plan")
    order = np.argsort(times, kind="stable")
    order = order[np.isfinite(times[order]) & ~np.isnan(values[order])]
    times, values = times[order], values[order]
    end = grid.start + grid.steps * grid.period
    if not len(times) or times[-1] < grid.start or times[0] >= end:
        first, last = moments([grid.start, end], settings.tz)
        raise DataError(
            f"the plan's {shown(name)} has no value between {first} and {last}, the time that is forecast; give the "
            "inputs that are planned for that time"
        )
    return Timed(times, values)


def _in_unit(values: float | Array | Timed, edge: Edge) -> Values:
    """The same in the network's unit."""
    if isinstance(values, Timed):
        return values._replace(values=np.array([edge.value(raw) for raw in values.values.tolist()]))
    if isinstance(values, float):
        return edge.value(values)
    return np.array([edge.value(raw) for raw in values.tolist()])
