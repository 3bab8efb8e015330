"""How the readings of one channel in one grid interval become one value (paper 4.3.1)."""

from collections.abc import Callable, Sequence
from math import fsum
from typing import NamedTuple

from adapters.units import ENERGIES


class Span(NamedTuple):
    """The readings of one channel in one interval, in the order of time, and where the interval begins and ends.

    Times are UTC seconds; there is at least one reading.
    """

    times: Sequence[float]
    values: Sequence[float]
    begin: float
    end: float


class Aggregate(NamedTuple):
    """A rule: of the readings in the order of time, the slice `used` is made one value by `combine`."""

    used: slice
    combine: Callable[[Span], float]


_ALL = slice(None)


def _mean(span: Span) -> float:
    values = span.values
    try:
        mean = fsum(values) / len(values)
    except OverflowError:
        mean = fsum(value / len(values) for value in values)
    # Rounding must not carry the mean of equal readings past them.
    return min(max(mean, min(values)), max(values))


def _time_weighted(span: Span) -> float:
    """Every reading counts for as long as it is the newest; what came before the first one of the interval, nothing."""
    edges = [*span.times, span.end]
    whole = span.end - span.times[0]
    mean = fsum(
        value * ((until - since) / whole)
        for value, since, until in zip(span.values, edges[:-1], edges[1:], strict=True)
    )
    return min(max(mean, min(span.values)), max(span.values))


def _only(span: Span) -> float:
    return span.values[0]


def _energy(span: Span) -> float:
    return fsum(span.values) / (span.end - span.begin)


AGGREGATES: dict[str, Aggregate] = {
    "mean": Aggregate(_ALL, _mean),
    "time_weighted": Aggregate(_ALL, _time_weighted),
    "first": Aggregate(slice(0, 1), _only),
    "last": Aggregate(slice(-1, None), _only),
    "min": Aggregate(_ALL, lambda span: min(span.values)),
    "max": Aggregate(_ALL, lambda span: max(span.values)),
    "sum": Aggregate(_ALL, lambda span: fsum(span.values)),
    "energy": Aggregate(_ALL, _energy),
}


def default_aggregate(unit: str, given: str | None = None) -> str:
    """The paper's rule for a channel of the network in `unit`: the first value of a switched power, the mean of
    anything else. Power that was made of a counter in the unit `given` is itself a mean."""
    return "first" if unit == "W" and given not in ENERGIES else "mean"
