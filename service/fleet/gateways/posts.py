"""What clients post, on its way from a gateway to the shards whose zones ask for it."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import replace
from http import HTTPStatus

from adapters.http.posted import Posted
from adapters.http.source import HttpSource
from service.config.site import Config
from service.daemon.supply.feeds import Handed
from service.errors import ServiceError
from service.fleet.gateways.views import ShardView
from service.records.receipt import NOTHING, Receipt
from service.web.readings import RETRY_SECONDS
from service.web.server.refusal import RequestRefused

TAKE_SECONDS = 30.0
"""How long the shards may take to make a post durable."""

_SHOWN = 5


class Posts:
    """Takes what is posted to a gateway (`service.web.readings.Take`)."""

    def __init__(self) -> None:
        self._sources: list[HttpSource] = []
        self._shards: Mapping[str, ShardView] = {}

    def adopt(self, config: Config, shards: Mapping[str, ShardView]) -> None:
        """The zones are those of `config`, each run by one of `shards`, by its id."""
        self._shards = shards
        names = [name for name, table in config.sources.items() if table.kind == "http"]
        built = [config.build_source(name) for name in names if config.zones_of(name)]
        self._sources = [source for source in built if isinstance(source, HttpSource)]

    async def take(self, posted: Sequence[Posted], zone: str | None) -> Receipt:
        """Hand `posted` to the shards; what counts as accepted is durable on return. Raises RequestRefused without a
        source to post to, and while a zone has no shard: then all of it may be posted again."""
        if not self._sources:
            sentence = 'no zone has a source that is posted to; add one with kind = "http", and channels that name it'
            raise RequestRefused(HTTPStatus.CONFLICT, [sentence])
        places, zones = self._addressed(posted, zone)
        asked = [
            shard.peer.ask("take", [posted[place] for place in places[name]], zone, zones[name], timeout=TAKE_SECONDS)
            for name, shard in self._by_name().items()
            if name in places
        ]
        results: list[Handed | BaseException] = await asyncio.gather(*asked, return_exceptions=True)
        receipt, used = NOTHING, set[int]()
        for result, own in zip(results, places.values(), strict=True):
            if isinstance(result, ServiceError):
                raise RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [str(result)], retry_after=RETRY_SECONDS)
            if isinstance(result, BaseException):
                raise result
            receipt = receipt.plus(result.receipt)
            used |= {own[place] for place in result.used}
        unknown = [one.shown for place, one in enumerate(posted) if place not in used]
        return replace(receipt, unknown=len(unknown), unknown_names=tuple(dict.fromkeys(unknown))[:_SHOWN])

    def _by_name(self) -> dict[str, ShardView]:
        return {shard.peer.name: shard for shard in self._shards.values()}

    def _addressed(
        self, posted: Sequence[Posted], zone: str | None
    ) -> tuple[dict[str, list[int]], dict[str, set[str]]]:
        """For every shard that a post concerns, which of its values by their places, and for which zones. In the order
        of the shards."""
        wanted: dict[str, set[int]] = {}
        zones: dict[str, set[str]] = {}
        for place, one in enumerate(posted):
            for source in self._sources:
                for asking in source.zones_of(one, zone):
                    shard = self._shards.get(asking)
                    if shard is None:
                        sentence = f"zone '{asking}' is being moved to another shard; post the readings again"
                        raise RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [sentence], retry_after=RETRY_SECONDS)
                    wanted.setdefault(shard.peer.name, set()).add(place)
                    zones.setdefault(shard.peer.name, set()).add(asking)
        return {name: sorted(wanted[name]) for name in self._by_name() if name in wanted}, zones
