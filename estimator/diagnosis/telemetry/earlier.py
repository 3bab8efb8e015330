"""What a zone had learned some days ago: to that it goes back when its telemetry turns out to have lied since."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from estimator.arrays import HOUR
from estimator.diagnosis.telemetry.lies import SETTLED, Suspicion
from estimator.thermostat.live import Live

_EVERY = 48 * HOUR
"""s between two that are kept. Two are, so that one of them is older than what a lie takes to be found."""


class Earlier(NamedTuple):
    """What was known at one time."""

    time: float
    """UTC s."""
    state: Any
    """The estimator's."""
    live: Live
    """What live forecasts had proved to be worth, and none that was pending."""


def keeps(earlier: tuple[Earlier, ...], time: float) -> bool:
    """Whether what is known is to be kept after a look at `time` [UTC s] that found nothing to suspect."""
    return not earlier or time - earlier[-1].time >= _EVERY


def kept(earlier: tuple[Earlier, ...], new: Earlier) -> tuple[Earlier, ...]:
    """`earlier` with a `new` one."""
    return (*earlier[-1:], new)


def doubtful_since(before: Iterable[Suspicion], now: Iterable[Suspicion], time: float) -> float | None:
    """Since when [UTC s] what is learned is not to be believed, at a look at `time` [UTC s]; None where it is.

    It is not while something is suspected, and once more when that ends: what was suspected `before`. After SETTLED it
    is the truth of now.
    """
    young = (one.since for one in (*before, *now) if time - one.since < SETTLED * HOUR)
    return min(young, default=None)


def differ(before: Iterable[Suspicion], now: Iterable[Suspicion]) -> bool:
    """Whether something is suspected `now` that was not `before`, or the other way round."""
    return {(one.name, one.column) for one in before} != {(one.name, one.column) for one in now}


def known_at(earlier: tuple[Earlier, ...], since: float) -> Earlier | None:
    """The newest of `earlier` that is not later than `since` [UTC s], else the oldest; None where there is none."""
    return next((one for one in reversed(earlier) if one.time <= since), earlier[0] if earlier else None)
