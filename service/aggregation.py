"""How the readings of one channel in one grid interval become one value (paper 4.3.1)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import fsum
from typing import NamedTuple

from service.errors import ConfigError


class Aggregate(NamedTuple):
    """A rule: of the readings in the order of time, the slice `used` is made one value by `combine`."""

    used: slice
    combine: Callable[[Sequence[float]], float]


_ALL = slice(None)


def _mean(values: Sequence[float]) -> float:
    try:
        mean = fsum(values) / len(values)
    except OverflowError:
        mean = fsum(value / len(values) for value in values)
    # Rounding must not carry the mean of equal readings past them.
    return min(max(mean, min(values)), max(values))


def _only(values: Sequence[float]) -> float:
    return values[0]


AGGREGATES: dict[str, Aggregate] = {
    "mean": Aggregate(_ALL, _mean),
    "first": Aggregate(slice(0, 1), _only),
    "last": Aggregate(slice(-1, None), _only),
    "min": Aggregate(_ALL, min),
    "max": Aggregate(_ALL, max),
    "sum": Aggregate(_ALL, fsum),
}


def aggregate(name: str) -> Aggregate:
    """The rule called `name`; ConfigError lists the right names otherwise."""
    if name not in AGGREGATES:
        raise ConfigError([f"aggregate '{name}' is unknown; the aggregates are {', '.join(AGGREGATES)}"])
    return AGGREGATES[name]


def default_aggregate(unit: str) -> str:
    """The paper's rule for a channel in `unit`: the first value of a switched power, the mean of anything else."""
    return "first" if unit == "W" else "mean"
