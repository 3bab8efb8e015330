"""Readings that clients post: to every source that is posted to, and an answer that can be relied on."""

import asyncio
import logging
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from http import HTTPStatus

from adapters.http.posted import Posted
from adapters.watched import Seldom
from service.daemon.supply.feeds import NO_SOURCE, Feed
from service.records.receipt import NOTHING, Receipt
from service.web.readings import RETRY_SECONDS
from service.web.server.refusal import RequestRefused

TOGETHER = 1000
"""Readings that are handed to the zones in one turn of the event loop, and values that are looked at: some ms of it."""
MAX_READINGS = 100_000
"""What a post may bring to all channels together."""
_SHOWN = 5

_log = logging.getLogger(__name__)


class Ingest:
    """Takes what was posted to the sources that run."""

    def __init__(self, feeds: Callable[[], Sequence[Feed]], expected: Callable[[], bool]) -> None:
        """`feeds` gives the sources at work, `expected` says whether one of them should be posted to."""
        self._feeds, self._expected = feeds, expected
        self._seldom = Seldom()

    async def take(self, posted: Sequence[Posted], zone: str | None) -> Receipt:
        """Hand `posted` to the zones, or to `zone` alone; what counts as accepted is durable on return. Raises
        RequestRefused without a source to post to, and ServiceError where the journal fails."""
        feeds = [feed for feed in self._feeds() if feed.is_posted_to]
        if not feeds and self._expected():
            sentence = "the daemon is starting, or going over to another configuration; post again in a moment"
            raise RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [sentence], retry_after=RETRY_SECONDS)
        if not feeds:
            raise RequestRefused(HTTPStatus.CONFLICT, [NO_SOURCE])
        receipt = await hand(feeds, posted, zone)
        if receipt.unknown and self._seldom("unknown"):
            count, such = receipt.unknown, receipt.unknown_names[0]
            _log.info("no channel asks for %d of %d posted values, such as %s", count, len(posted), such)
        return receipt


async def hand(feeds: Iterable[Feed], posted: Sequence[Posted], zone: str | None) -> Receipt:
    """What became of `posted` at those of `feeds` that are posted to, all of them together. Raises ServiceError, and
    RequestRefused where many channels ask for many values.

    Values go in the order of their times, TOGETHER in a turn of the event loop. Where one turn fails, those before it
    stay accepted: who posts again is told that they are known.
    """
    feeds = [feed for feed in feeds if feed.is_posted_to]
    receipt, unknown, now = NOTHING, list[Posted](), time.time()
    ordered = sorted(posted, key=lambda one: now if one.time is None else one.time)
    parts, room, count = list[list[Posted]](), 0, 0
    for place, one in enumerate(ordered):
        if place % TOGETHER == TOGETHER - 1:
            await asyncio.sleep(0)
        if not (asking := sum(feed.asking(one, zone) for feed in feeds)):
            unknown.append(one)
            continue
        bounded(count := count + asking)
        # One value may be that of every zone, such as the outdoor temperature.
        if asking > room:
            parts.append([])
            room = TOGETHER
        parts[-1].append(one)
        room -= asking
    for part in parts:
        for feed in feeds:
            receipt = receipt.plus(await feed.receive(part, zone))
        await asyncio.sleep(0)
    return with_unknown(receipt, unknown)


def bounded(count: int) -> None:
    """RequestRefused where a post brings more than MAX_READINGS."""
    if count > MAX_READINGS:
        sentence = f"so many channels ask for these values that they are more than {MAX_READINGS} readings; post fewer"
        raise RequestRefused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, [f"{sentence} at a time"])


def with_unknown(receipt: Receipt, unknown: Sequence[Posted]) -> Receipt:
    """`receipt` with the values that no channel asks for, and what some of them are called."""
    names = dict.fromkeys(one.shown for one in unknown[:TOGETHER])
    return replace(receipt, unknown=len(unknown), unknown_names=tuple(names)[:_SHOWN])
