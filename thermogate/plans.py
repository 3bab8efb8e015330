"""A plan, as people write it in a notebook, in the grammar of plans."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from adapters.edge import PLAIN, Edge
from adapters.fields.durations import parse_duration
from adapters.fields.words import shown, suggestion
from estimator.arrays import Array
from service.config.fitting import plannable
from service.errors import DataError, PlanError, RequestError
from service.forecast.plan import Grid, Inputs, Timed, Values, check, check_price
from service.forecast.request import whole_steps
from service.records.outlook import SET_POINTS
from thermogate.arguments import duration, plain
from thermogate.frames import clock, moments, numbers, pandas
from thermogate.settings import Settings, with_auto


def steps_in(horizon: object, period: float) -> int:
    """How many periods [s] make up `horizon`; DataError for none or no whole number."""
    try:
        return whole_steps(parse_duration(duration(horizon)), period)
    except ValueError as error:
        raise DataError(f"horizon: {error}") from None
    except RequestError as error:
        raise DataError(str(error)) from None


def planned_inputs(plan: object, settings: Settings, begin: float, steps: int) -> Inputs:
    """What `plan` says of the inputs over `steps` steps from `begin`, UTC s, on, in the network's units. DataError with
    the place of what cannot be used."""
    found, grid, limits = {}, Grid(begin, settings.zone.period, steps), plannable(settings.zone)
    for name, given in _columns(plan, settings).items():
        for channel, edge in _meant(name, settings):
            values = _in_unit(_values(name, given, settings, grid), edge)
            try:
                check(values, channel, settings.zone.network, limits, grid)
            except PlanError as error:
                raise DataError(f"the plan's {shown(name)} {error}") from None
            found[channel] = values
    return found


def planned_setpoints(plan: object, settings: Settings, begin: float, steps: int) -> Values:
    """The set-points [degC] that `plan` says, as `planned_inputs` does; DataError for a plan of anything else."""
    found = planned_inputs(plan, settings, begin, steps)
    if set(found) != {SET_POINTS}:
        others = ", ".join(name for name in found if name != SET_POINTS) or "nothing"
        raise DataError(f'the plan has {others}; here it plans set-points only, such as {{"{SET_POINTS}": 20.0}}')
    return found[SET_POINTS]


def planned_price(price: object, settings: Settings, begin: float, steps: int) -> Values:
    """What a kWh costs over `steps` steps from `begin`, UTC s, on."""
    grid = Grid(begin, settings.zone.period, steps)
    values = _values("price", price, settings, grid)
    try:
        check_price(values, grid)
    except PlanError as error:
        raise DataError(f"the price {error}") from None
    return values


def _columns(plan: object, settings: Settings) -> dict[str, Any]:
    """The columns of a plan by name; those of a DataFrame that cannot be planned are left out."""
    if plan is None:
        return {}
    if isinstance(plan, Mapping):
        return dict(plan)
    if not isinstance(plan, pandas().DataFrame):
        raise DataError('the plan must be a DataFrame or a dict such as {"u_heat": 1500.0}, not ' + shown(plan))
    read = {name for column in settings.columns for name in (column.name, *column.sources)}
    passed_over = (read | set(settings.other_columns)) - _names(settings).keys()
    return {str(name): plan[name] for name in plan.columns if str(name) not in passed_over}


def _names(settings: Settings) -> dict[str, list[tuple[str, Edge | None]]]:
    """What an input can be called in a plan: its column, in the column's unit, or its channel, in the network's. The
    conversion is None for a column that counts energy, which nobody can plan."""
    names: dict[str, list[tuple[str, Edge | None]]] = {}
    for one in settings.plannable:
        if len(one.sources) == 1:
            counts = one.edge.counter or one.channel.aggregate == "energy"
            names.setdefault(one.sources[0], []).append((one.name, None if counts else one.edge))
    for one in settings.plannable:
        names.setdefault(one.name, [(one.name, PLAIN)])
    return names


def _meant(name: str, settings: Settings) -> list[tuple[str, Edge]]:
    names = _names(settings)
    if name not in names:
        units = [f"{column.name} [{column.unit}]" for column in settings.plannable]
        close = suggestion(name, names, "").partition("; ")[2]
        raise DataError(
            f"the plan has {shown(name)}, which is no input of the model; its inputs are {', '.join(units)}"
            + (f"; {close}" if close else with_auto(name))
        )
    found = []
    for channel, edge in names[name]:
        if edge is None:
            unit = settings.zone.network.channel_unit(channel)
            raise DataError(f"the plan has {shown(name)}, which counts energy; plan {channel} in {unit} instead")
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
    if isinstance(values, Timed):
        return values._replace(values=np.array([edge.value(raw) for raw in values.values.tolist()]))
    if isinstance(values, float):
        return edge.value(values)
    return np.array([edge.value(raw) for raw in values.tolist()])
