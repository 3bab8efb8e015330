"""Targets, and whether what came out meets them: always computed from the results."""

from __future__ import annotations

import math
from collections.abc import Sequence
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


def at_most(target: str, values: Sequence[float], limit: float) -> Verdict:
    """Met when the mean over seeds is no more than `limit`."""
    return _verdict(target, f"at most {number(limit)}", values, -math.inf, limit)


def at_least(target: str, values: Sequence[float], limit: float) -> Verdict:
    """Met when the mean over seeds is no less than `limit`."""
    return _verdict(target, f"at least {number(limit)}", values, limit, math.inf)


def between(target: str, values: Sequence[float], low: float, high: float) -> Verdict:
    """Met when the mean over seeds lies in [low, high]."""
    return _verdict(target, f"{number(low)} to {number(high)}", values, low, high)


def near(target: str, values: Sequence[float], reference: float, share: float) -> Verdict:
    """Met when the mean over seeds is off `reference` by no more than `share` of it."""
    wanted = f"{number(reference)} within {100 * share:.0f} %"
    return _verdict(target, wanted, values, (1 - share) * reference, (1 + share) * reference)


def within(target: str, values: Sequence[float], reference: float, distance: float) -> Verdict:
    """Met when the mean over seeds is off `reference` by no more than `distance`."""
    wanted = f"{number(reference)} ± {number(distance)}"
    return _verdict(target, wanted, values, reference - distance, reference + distance)


def verdict_table(verdicts: Sequence[Verdict]) -> Table:
    """All verdicts, in their order."""
    marks = {True: "met", False: "missed", None: "open"}
    return Table(
        "verdicts",
        "Targets",
        ("target", "wanted", "found (mean ± sd over seeds)", "verdict", "missed by"),
        tuple(
            (v.target, v.wanted, v.found, marks[v.met], None if v.off is None else f"{100 * v.off:.1f} %")
            for v in verdicts
        ),
        "A verdict holds for the mean over the seeds; 'open' means that this run did not include what it takes.",
    )


def _verdict(target: str, wanted: str, values: Sequence[float], low: float, high: float) -> Verdict:
    if not len(values) or math.isnan(sum(values)):
        return Verdict(target, wanted, None, None)
    found = spread(values)
    nearest = min(max(found.mean, low), high)
    if nearest == found.mean:
        return Verdict(target, wanted, found, True)
    return Verdict(target, wanted, found, False, abs(found.mean / nearest - 1.0))
