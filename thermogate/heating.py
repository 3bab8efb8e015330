"""Answers about the heating of a zone as pandas has them."""

from collections.abc import Sequence
from typing import Any

from service.forecast.answers import Comparison, Demand, PlanOutcome, Preheat, Range
from thermogate.frames import Frame, moments, pandas, table

BOUNDS_95 = ("mean", "lower", "upper")
"""Of a `Range`."""


def preheat_series(found: Preheat, tz: str) -> Any:
    """A Series; `start` is NaT where not even now is early enough."""
    start = float("nan") if found.start is None else found.start
    issued, by, begin = pandas().to_datetime([found.issue_time, found.by, start], unit="s", utc=True).tz_convert(tz)
    values = {
        "start": begin,
        "minutes": found.minutes,
        "reached": found.reached,
        **{f"temperature_{bound}": getattr(found.temperature, bound) for bound in BOUNDS_95},
        **{f"energy_{bound}": getattr(found.energy, bound) for bound in BOUNDS_95},
        "target": found.target,
        "by": by,
        "probability": found.probability,
        "tolerance": found.tolerance,
        "setpoint_before": found.setpoint_before,
        "issue_time": issued,
        "trust": found.trust,
    }
    return pandas().Series(values, name="preheat", dtype=object)


def demand_table(found: Demand, tz: str) -> Frame:
    return _ranges([hour.energy for hour in found.hours], moments([hour.begin for hour in found.hours], tz))


def demand_total(found: Demand) -> Any:
    return _ranges([found.total], ["total"]).iloc[0]


def comparison_table(found: Comparison) -> Frame:
    """A row for every plan: what it comes to, and how much more than the first of them."""
    index = pandas().Index([one.name for one in found.plans], name="plan")
    columns = _outcomes(found.plans, "")
    changes = _outcomes(found.differences, "_difference")
    return table(columns | {key: [0.0, *values] for key, values in changes.items()}, index)


def _ranges(found: Sequence[Range], index: Any) -> Frame:
    return table({bound: [getattr(one, bound) for one in found] for bound in BOUNDS_95}, index)


def _outcomes(found: Sequence[PlanOutcome], suffix: str) -> dict[Any, list[float]]:
    quantities = ["energy", *(["cost"] if found[0].cost is not None else []), "hours_below"]
    return {
        (quantity + suffix, bound): [getattr(getattr(one, quantity), bound) for one in found]
        for quantity in quantities
        for bound in BOUNDS_95
    }
