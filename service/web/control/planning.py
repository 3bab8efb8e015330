"""From the plans of a request to the inputs of every period of a zone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from adapters.reading import Quality
from adapters.units import default_valid_range
from estimator.arrays import Array
from estimator.network.network import Network
from service.fields.durations import format_duration
from service.records.outlook import InputOrigin, Outlook
from service.web.control.models import EVERY_ZONE, PlannedInput, SitePlan, SteppedValues, TimedValue

_ROUNDING = 1e-6

Limits = Mapping[str, tuple[float, float]]


def planned_values(value: PlannedInput, start: int, period: float, steps: int) -> Array | str:
    """`value` over `steps` intervals of `period` s from UTC s `start` on, NaN where it says nothing; or what is wrong
    with it."""
    if isinstance(value, int | float):
        return np.full(steps, float(value))
    if isinstance(value, SteppedValues):
        return _stepped(value, period, steps)
    if isinstance(value[0], TimedValue):
        return _timed([one for one in value if isinstance(one, TimedValue)], start, period, steps)
    if len(value) != steps:
        return (
            f"has {len(value)} values, but the horizon has {steps} steps of {format_duration(period)}; give {steps} "
            "values, one number for all, or {step, values}"
        )
    return np.array(value, dtype=np.float64)


def mistakes(plan: SitePlan, zone: str, network: Network, place: str, seen: set[str]) -> list[str]:
    """What `plan` names of `zone` that it does not have; `seen` collects what it plans for every zone and finds."""
    found = []
    for channel in plan.inputs.get(zone, {}):
        if channel not in network.inputs:
            known = ", ".join(network.inputs)
            found.append(f"field '{place}.{zone}.{channel}' is not an input of this zone; its inputs are {known}")
    seen |= {channel for channel in plan.inputs.get(EVERY_ZONE, {}) if channel in network.inputs}
    return found


def inputs_of(plan: SitePlan, zone: str, network: Network) -> dict[str, tuple[str, PlannedInput]]:
    """What `plan` plans for `zone`, by channel, each with the zone of the plan that says so: its own goes before
    that of every zone."""
    shared = {name: (EVERY_ZONE, value) for name, value in plan.inputs.get(EVERY_ZONE, {}).items()}
    own = {name: (zone, value) for name, value in plan.inputs.get(zone, {}).items()}
    return {name: told for name, told in (shared | own).items() if name in network.inputs}


def beyond(values: Sequence[float] | Array, channel: str, network: Network, limits: Limits) -> str | None:
    """Why `values` of `channel` may not be planned; None if they may."""
    unit = network.channel_unit(channel)
    lower, upper = limits.get(channel, default_valid_range(unit))
    known = np.asarray(values)[~np.isnan(values)]
    wrong = known[(known < lower) | (known > upper)]
    if not wrong.size:
        return None
    return (
        f"plans {wrong[0]:g} {unit}; {lower:g} to {upper:g} {unit} can be planned, by valid, installed and nominal of "
        "the channel"
    )


def filled(outlook: Outlook, network: Network, planned: Mapping[str, Array]) -> Outlook:
    """`outlook` with what is `planned` in place of what is foreseen."""
    rows, origins = outlook.rows.copy(), []
    for column, origin in enumerate(outlook.origins):
        values = planned.get(network.inputs[column])
        if values is not None:
            known = ~np.isnan(values)
            rows[known, column] = values[known]
            quality = Quality.GOOD if known.all() else Quality.UNCERTAIN
            origin = InputOrigin(origin.channel, "plan", "", float("nan"), quality)
        origins.append(origin)
    return Outlook(rows, tuple(origins))


def _stepped(given: SteppedValues, period: float, steps: int) -> Array | str:
    each = round(given.step / period)
    if each < 1 or abs(each * period - given.step) > _ROUNDING:
        return (
            f"has the step {format_duration(given.step)}, which is not a whole number of the zone's periods of "
            f"{format_duration(period)}"
        )
    needed = -(-steps // each)
    if len(given.values) != needed:
        return f"has {len(given.values)} values of {format_duration(given.step)}; the horizon takes {needed} of them"
    return np.repeat(np.array(given.values, dtype=np.float64), each)[:steps]


def _timed(given: Sequence[TimedValue], start: int, period: float, steps: int) -> Array | str:
    """Means of a value that changes at times; NaN for intervals that end before the first of them."""
    times = np.array([one.time.timestamp() for one in given])
    values = np.array([one.value for one in given])
    if (np.diff(times) <= 0.0).any():
        return "has times that do not increase; put every time once, in order"
    edges = start + period * np.arange(steps + 1)
    # The integral from the first time on, at every change and at every edge.
    at_changes = np.concatenate([[0.0], np.cumsum(np.diff(times) * values[:-1])])
    inside = np.maximum(edges, times[0])
    last = np.maximum(np.searchsorted(times, inside, side="right") - 1, 0)
    integral = at_changes[last] + (inside - times[last]) * values[last]
    covered = np.diff(inside)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.diff(integral) / np.where(covered > 0.0, covered, np.nan), dtype=np.float64)
