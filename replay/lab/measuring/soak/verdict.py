"""Whether a daemon's holdings stay level: slopes per simulated day after the warm-up, against limits stated here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import theilslopes

from replay.lab.measuring.soak.observation import Observation

WARM_UP = 1 / 2
"""Part of the soak that is not judged: caches, pools and buffers fill."""

_DAY = 86_400.0


class Limit(NamedTuple):
    """`figure` of an observation may grow by less than `most` `unit` over one `by`."""

    figure: str
    most: float
    unit: str
    by: str


LIMITS = (
    Limit("resident_mb", 1.0, "MB", "simulated day"),
    Limit("descriptors", 0.5, "descriptors", "simulated day"),
    Limit("threads", 0.5, "threads", "simulated day"),
    Limit("disk_mb", 1.0, "MB", "1,000 accepted samples"),
)


class Verdict(NamedTuple):
    """A slope with its 95 % interval, in `limit.unit` per `limit.by`, and whether it is within the limit."""

    limit: Limit
    slope: float
    lower: float
    upper: float
    within: bool


def judge(observations: Sequence[Observation], pace: float) -> list[Verdict]:
    """A verdict for each of LIMITS, from Theil and Sen's slope, which a few peaks do not move.

    `pace`: simulated s per real s.
    """
    settled = observations[int(len(observations) * WARM_UP) :]
    days = np.array([one.elapsed for one in settled]) * pace / _DAY
    thousands = np.array([one.samples for one in settled]) / 1000.0
    verdicts = []
    for limit in LIMITS:
        values = np.array([getattr(one, limit.figure) for one in settled], dtype=float)
        over = days if limit.by == "simulated day" else thousands
        # Where little has changed there are so many ties that the bounds are not defined (NaN).
        with np.errstate(invalid="ignore"):
            slope, _, lower, upper = map(float, theilslopes(values, over))
        verdicts.append(Verdict(limit, slope, lower, upper, slope < limit.most))
    return verdicts


def summary(observations: Sequence[Observation], pace: float) -> dict[str, Any]:
    """The first, the settled and the last values of what was observed, and the delay of the event loop."""
    settled = observations[int(len(observations) * WARM_UP) :]
    first, last = settled[0], observations[-1]
    timers = max(last.timers - first.timers, 1.0)
    return {
        "simulated_hours": last.elapsed * pace / 3600.0,
        "real_seconds": last.elapsed,
        "observations": len(observations),
        "first": observations[0]._asdict(),
        "after_warm_up": first._asdict(),
        "last": last._asdict(),
        "largest_resident_mb": max(one.resident_mb for one in observations),
        "largest_descriptors": max(one.descriptors for one in observations),
        "late_timers_share": (last.late_timers - first.late_timers) / timers,
        "cores_used": (last.cpu_s - first.cpu_s) / max(last.elapsed - first.elapsed, 1e-9),
    }
