"""Targets, and whether what came out meets them: always computed from the results."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from replay.reports.kit.table import Spread, Table, number, spread


class Verdict(NamedTuple):
    """One target: what was wanted, what came out, and whether that is enough (None: it was not run)."""

    target: str
    wanted: str
    found: Spread | None
    met: bool | None
    off: float | None = None
    """How far the mean lies beyond the nearest value that would do, as a share of that value."""


class Wanted(NamedTuple):
    """A range in which the mean over seeds has to lie, and how it is written."""

    low: float
    high: float
    text: str

    def judge(self, target: str, values: Sequence[float]) -> Verdict:
        """Whether the mean of `values`, one for each seed, meets the `target`."""
        if not len(values) or math.isnan(sum(values)):
            return Verdict(target, self.text, None, None)
        found = spread(values)
        nearest = min(max(found.mean, self.low), self.high)
        met = nearest == found.mean
        return Verdict(target, self.text, found, met, None if met else abs(found.mean / nearest - 1.0))


def at_most(limit: float) -> Wanted:
    return Wanted(-math.inf, limit, f"at most {number(limit)}")


def at_least(limit: float) -> Wanted:
    return Wanted(limit, math.inf, f"at least {number(limit)}")


def between(low: float, high: float) -> Wanted:
    return Wanted(low, high, f"{number(low)} to {number(high)}")


def near(reference: float, share: float) -> Wanted:
    return Wanted((1 - share) * reference, (1 + share) * reference, f"{number(reference)} within {100 * share:.0f} %")


WANTED: Mapping[str, Callable[..., Wanted]] = {kind.__name__: kind for kind in (at_most, at_least, between, near)}


def verdict_table(verdicts: Sequence[Verdict]) -> Table:
    marks = {True: "met", False: "missed", None: "open"}
    return Table(
        "verdicts",
        ("target", "wanted", "found (mean ± sd over seeds)", "verdict", "missed by"),
        tuple(
            (v.target, v.wanted, v.found, marks[v.met], None if v.off is None else f"{100 * v.off:.1f} %")
            for v in verdicts
        ),
        "Targets",
        "A verdict holds for the mean over the seeds; 'open' means that this run did not include what it takes.",
    )
