"""What each source brings, split by zone, aligned and accepted; its failures retried. And the wall clock."""

import asyncio
import logging
import random
import time
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import aclosing
from dataclasses import dataclass
from math import inf, isfinite, nextafter

from adapters.errors import SourceConfigError, SourceError
from adapters.reading import Source
from adapters.routing import Delivery, Router
from service.pauses import GrowingPause
from service.zone.clock import Clock
from service.zone.zone import Zone

FIRST_PAUSE = 1.0
LONGEST_PAUSE = 30.0
TICK = 0.5
"""How often the wall clock is looked at, in s."""
NOTABLE_JUMP = 2.0
"""What the wall clock may be set by without a word, in s."""
TOGETHER = 32
"""Zones that take in their shares in one turn of the event loop: some ms of it at most."""

_log = logging.getLogger(__name__)


@dataclass
class Tally:
    """What a source has done since the daemon started."""

    readings: int = 0
    failures: int = 0
    delivers: bool = False
    """Whether it is at work and did not fail since it last delivered."""
    last: float | None = None
    """When it last delivered, UTC s."""


async def persevere(
    kind: str,
    name: str,
    attempt: Callable[[Callable[[bool], None]], Awaitable[None]],
    failed: Callable[[str], Awaitable[None]],
    pause: GrowingPause,
) -> bool:
    """Make `attempt` until it comes to its end, again after every failure, of which `failed` hears why; False if it is
    described wrongly. `attempt` tells what it is given of everything that came, and whether that is progress, after
    which pauses are short again. `name` is that of a table [`kind`s.`name`]."""
    failing = False

    def came(progress: bool) -> None:
        nonlocal failing
        if failing:
            failing = False
            _log.info("%s '%s' works again", kind, name)
        if progress:
            pause.reset()

    while True:
        try:
            await attempt(came)
            return True
        except Exception as error:
            # Whatever goes wrong in one source must not take the others down.
            place = f"{kind}.{name}" if kind == "weather" else f"{kind}s.{name}"
            reason = str(error) if isinstance(error, SourceError) else f"{place} failed: {error!r}"
            _log.debug("%s", reason, exc_info=error)
            hopeless = isinstance(error, SourceConfigError)
        # Many daemons behind one switch must not all come back at the same moment.
        wait = pause.seconds * random.uniform(0.5, 1.0)
        _log.error("%s; %s", reason, "it stays off" if hopeless else f"trying again in {wait:.1f} s")
        await failed(reason)
        if hopeless:
            return False
        failing = True
        await asyncio.sleep(wait)
        pause.grow()


async def feed(
    source: Source, router: Router, zones: Mapping[str, Zone], start: float | None, tally: Tally | None = None
) -> None:
    """Deliver `source` to `zones` from UTC time `start` on until it ends, counted in `tally`. One that is unavailable
    is asked again from its own last clock on."""
    tally, position = tally or Tally(), start

    def takers() -> Iterator[Zone]:
        # One after the other: a reload may take one away meanwhile.
        for name in router.zones:
            if (taker := zones.get(name)) is not None:
                yield taker

    async def deliver(came: Callable[[bool], None]) -> None:
        nonlocal position
        async with aclosing(source.batches(position)) as batches:  # type: ignore[type-var]
            async for batch in batches:
                tally.readings += len(batch.readings)
                tally.delivers, tally.last = True, time.time()
                await _deliver(router.split(batch), zones)
                came(isfinite(batch.now))
                if isfinite(batch.now):
                    # Were it asked again, it is for what comes after this.
                    position = nextafter(batch.now, inf)

    async def failed(reason: str) -> None:
        tally.failures += 1
        tally.delivers = False
        for taker in takers():
            await taker.source_failed(source.name, reason)

    if await persevere("source", source.name, deliver, failed, GrowingPause(FIRST_PAUSE, LONGEST_PAUSE)):
        for taker in takers():
            await taker.end(source.name)
        _log.info("source '%s' has come to its end; the zones keep their last forecasts", source.name)


async def _deliver(deliveries: Sequence[Delivery], zones: Mapping[str, Zone]) -> None:
    """Hand every zone its share, some zones at a time, whose samples then share a commit of the journal."""
    for first in range(0, len(deliveries), TOGETHER):
        # A zone that a reload has taken away meanwhile wants nothing more.
        delivering = [
            zones[share.zone].intake.deliver(share.source, share.readings, share.now)
            for share in deliveries[first : first + TOGETHER]
            if share.zone in zones
        ]
        # One zone's failure must not keep the others from their samples.
        for result in await asyncio.gather(*delivering, return_exceptions=True):
            if isinstance(result, BaseException):
                raise result


async def keep_time(zones: Mapping[str, Zone]) -> None:
    """Let the wall clock close the intervals of live zones, for ever."""
    while True:
        await asyncio.sleep(TICK)
        due = [zone for zone in tuple(zones.values()) if zone.intake.is_due()]
        for first in range(0, len(due), TOGETHER):
            together = due[first : first + TOGETHER]
            results = await asyncio.gather(*(zone.intake.keep_time() for zone in together), return_exceptions=True)
            for zone, result in zip(together, results, strict=True):
                if isinstance(result, Exception):
                    _log.error("zone '%s' cannot close its interval: %r", zone.id, result)


async def watch_clock(clock: Clock) -> None:
    """Say when the wall clock of this machine is set, or has gone on while the machine slept, for ever."""
    beside = clock.wall() - clock.steady()
    while True:
        await asyncio.sleep(TICK)
        jump = clock.wall() - clock.steady() - beside
        if abs(jump) > NOTABLE_JUMP:
            _log.warning("the wall clock of this machine was set by %+.1f s, or the machine slept", jump)
            beside += jump
