"""What clients post, on its way from a gateway to the shards whose zones ask for it."""

import asyncio
from collections.abc import Mapping, Sequence
from http import HTTPStatus

from adapters.http.posted import Posted
from adapters.http.source import HttpSource
from service.config.site import Config
from service.daemon.supply.feeds import NO_SOURCE
from service.daemon.supply.ingest import bounded, with_unknown
from service.errors import ServiceError
from service.fleet.peers import Peer
from service.records.receipt import NOTHING, Receipt
from service.web.readings import RETRY_SECONDS
from service.web.server.refusal import RequestRefused

TAKE_SECONDS = 30.0
"""How long the shards may take to make a post durable."""


class Posts:
    """Takes what is posted to a gateway (`service.web.site.Take`)."""

    def __init__(self) -> None:
        self._sources: list[HttpSource] = []
        self._shards: Mapping[str, Peer] = {}

    def adopt(self, config: Config, shards: Mapping[str, Peer]) -> None:
        """The zones are those of `config`, each run by one of `shards`, by its id."""
        self._shards = shards
        names = [name for name, table in config.sources.items() if table.kind == "http"]
        built = [config.build_source(name) for name in names if config.zones_of(name)]
        self._sources = [source for source in built if isinstance(source, HttpSource)]

    async def take(self, posted: Sequence[Posted], zone: str | None) -> Receipt:
        """Hand `posted` to the shards of the zones that ask for it; durable on return. Raises RequestRefused without a
        source to post to, and while a zone has no shard: then all of it may be posted again."""
        if not self._sources:
            raise RequestRefused(HTTPStatus.CONFLICT, [NO_SOURCE])
        expected, unknown, count = dict[Peer, set[str]](), list[Posted](), 0
        for one in posted:
            asking = [name for source in self._sources for name in source.zones_of(one, zone)]
            bounded(count := count + len(asking))
            for name in asking:
                expected.setdefault(self._shards[name], set()).add(name)
            if not asking:
                unknown.append(one)
        asked = (shard.ask("take", posted, zone, zones, timeout=TAKE_SECONDS) for shard, zones in expected.items())
        results: list[Receipt | BaseException] = await asyncio.gather(*asked, return_exceptions=True)
        found = NOTHING
        for result in results:
            if isinstance(result, ServiceError):
                raise RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [str(result)], retry_after=RETRY_SECONDS)
            if isinstance(result, BaseException):
                raise result
            found = found.plus(result)
        return with_unknown(found, unknown)
