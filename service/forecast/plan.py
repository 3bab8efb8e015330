"""The grammar of plans: what is planned of an input, and its value in every period."""

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from adapters.fields.durations import format_duration
from adapters.fields.times import written_time
from adapters.units import default_valid_range
from estimator.arrays import Array
from estimator.network.network import Network
from service.errors import PlanError
from service.records.outlook import SET_POINT_RANGE, SET_POINTS

EVERY_ZONE = "*"
"""Stands for every zone that has the input, in a plan."""
_ROUNDING = 1e-6
_DEAREST = 1e9
"""For a kWh: no currency has prices like this."""

Limits = Mapping[str, tuple[float, float]]


class Stepped(NamedTuple):
    """One of `values` (m,) for each `step` [s] from the beginning on."""

    step: float
    values: Array


class Timed(NamedTuple):
    """`values` (m,), each of which holds from its time on until the next; `times` (m,) are UTC s."""

    times: Array
    values: Array


Values = float | Array | Stepped | Timed
"""What is planned of one input, in the network's unit: a number for the whole horizon, or an array (h,) of one number
per period, or a coarser grid, or values with times."""

Inputs = Mapping[str, Values]
"""What is planned of one zone, by input channel."""


class Plan(NamedTuple):
    """A plan for the site: the inputs of each zone, and under EVERY_ZONE those of all that have them."""

    name: str = ""
    inputs: Mapping[str, Inputs] = {}

    def of(self, zone: str, inputs: Collection[str]) -> dict[str, tuple[str, Values]]:
        """What is planned of the `inputs` of `zone`, by channel, each with the zone of the plan that it stands under:
        what is planned for the zone itself goes before what is planned for every one."""
        shared = {name: (EVERY_ZONE, values) for name, values in self.inputs.get(EVERY_ZONE, {}).items()}
        own = {name: (zone, values) for name, values in self.inputs.get(zone, {}).items()}
        return {name: found for name, found in (shared | own).items() if name in inputs}


class Grid(NamedTuple):
    """The periods of a forecast: `steps` of `period` s from UTC s `start` on."""

    start: float
    period: float
    steps: int


def column(values: Values, grid: Grid) -> Array:
    """(h,): `values` in every period of `grid`, NaN where nothing is planned. PlanError for values that do not fit."""
    if isinstance(values, Stepped):
        return _stepped(values, grid)
    if isinstance(values, Timed):
        return _timed(values, grid)
    if isinstance(values, int | float):
        return np.full(grid.steps, float(values))
    if len(values) != grid.steps:
        raise PlanError(
            f"has {len(values)} values, but the horizon has {grid.steps} steps of {format_duration(grid.period)}; give "
            f"{grid.steps} values, or one number for all"
        )
    return np.asarray(values, dtype=np.float64)


def check_price(values: Values, grid: Grid) -> None:
    """PlanError if `values` do not say what a kWh costs in every period of `grid`."""
    prices = column(values, grid)
    if (np.abs(prices) > _DEAREST).any():
        raise PlanError(f"is more than {_DEAREST:g} for a kWh; give it in a larger unit of the currency")
    if np.isnan(prices).any():
        raise PlanError(f"says nothing of the time before its first value; begin it at {written_time(grid.start)}")


def check(values: Values, channel: str, network: Network, limits: Limits, grid: Grid) -> None:
    """PlanError if `values` cannot be planned of `channel`: they do not fit the grid, or are beyond its limits."""
    unit = "degC" if channel == SET_POINTS else network.channel_unit(channel)
    usual = SET_POINT_RANGE if channel == SET_POINTS else default_valid_range(unit)
    lower, upper = limits.get(channel, usual)
    planned = column(values, grid)
    wrong = planned[(planned < lower) | (planned > upper)]
    if wrong.size:
        raise PlanError(
            f"plans {wrong[0]:g} {unit}; {lower:g} to {upper:g} {unit} can be planned, by valid, installed and nominal "
            "of the channel"
        )


def _stepped(given: Stepped, grid: Grid) -> Array:
    each = round(given.step / grid.period)
    if each < 1 or abs(each * grid.period - given.step) > _ROUNDING:
        raise PlanError(
            f"has the step {format_duration(given.step)}, which is not a whole number of the zone's periods of "
            f"{format_duration(grid.period)}"
        )
    needed = -(-grid.steps // each)
    if len(given.values) != needed:
        raise PlanError(
            f"has {len(given.values)} values of {format_duration(given.step)}; the horizon takes {needed} of them"
        )
    return np.repeat(np.asarray(given.values, dtype=np.float64), each)[: grid.steps]


def _timed(given: Timed, grid: Grid) -> Array:
    """Means of a value that changes at times; NaN for periods that end before the first of them."""
    times, values = given
    if (np.diff(times) <= 0.0).any():
        raise PlanError("has times that do not increase; put every time once, in order")
    edges = grid.start + grid.period * np.arange(grid.steps + 1)
    # The integral from the first time on, at every change and at every edge.
    at_changes = np.concatenate([[0.0], np.cumsum(np.diff(times) * values[:-1])])
    inside = np.maximum(edges, times[0])
    last = np.maximum(np.searchsorted(times, inside, side="right") - 1, 0)
    integral = at_changes[last] + (inside - times[last]) * values[last]
    covered = np.diff(inside)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = np.diff(integral) / np.where(covered > 0.0, covered, np.nan)
    # Where nothing changes within a period the value is the mean, to the last digit.
    until = np.searchsorted(times, inside[1:], side="left") - 1
    return np.where((covered > 0.0) & (until <= last[:-1]), values[last[:-1]], means)
