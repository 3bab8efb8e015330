"""What a zone had learned some days ago: to that it goes back when its telemetry turns out to have lied since."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from estimator.diagnosis.telemetry.lies import SETTLED, Suspicion
from estimator.thermostat.live import Live

_HOUR = 3600.0

_EVERY = 48 * _HOUR
"""s between two that are kept. Two are, so that one of them is older than what a lie takes to be found."""


class Earlier(NamedTuple):
    """What was known at one time."""

    time: float
    """UTC s."""
    state: Any
    """The estimator's."""
    live: Live
    """What live forecasts had proved to be worth, and none that was pending."""


def kept(earlier: tuple[Earlier, ...], time: float, state: Any, live: Live) -> tuple[Earlier, ...]:
    """`earlier` after a look at `time` [UTC s] that found nothing to suspect; nothing is pending in `live`."""
    if earlier and time - earlier[-1].time < _EVERY:
        return earlier
    return (*earlier[-1:], Earlier(time, state, live))


def before_lies(
    earlier: tuple[Earlier, ...], before: Iterable[Suspicion], now: Iterable[Suspicion], time: float
) -> Earlier | None:
    """What a zone goes back to at `time` [UTC s] when something is suspected `now` that was not `before`, or the other
    way round; else None."""
    stood, stands = ({(one.name, one.column): one.since for one in each} for each in (before, now))
    begun = [since for key, since in stands.items() if key not in stood]
    ended = [since for key, since in stood.items() if key not in stands and time - since < SETTLED * _HOUR]
    if not earlier or not begun + ended:
        return None
    since = min(begun + ended)
    return next((one for one in reversed(earlier) if one.time <= since), earlier[0])
