"""Recorded sources merged by their own clocks: how `thermogate replay` reads a configuration's telemetry."""

from collections.abc import AsyncIterator, Collection
from math import inf, isfinite

from adapters.errors import SourceError
from adapters.routing import Delivery, Router
from service.config.site import Config
from service.errors import ServiceError


async def recorded(
    config: Config, zones: Collection[str], start: float | None, end: float | None
) -> AsyncIterator[Delivery]:
    """Deliver the recordings that feed `zones` from UTC time `start` up to `end`, the furthest behind first; at the end
    of a source its clock is infinite. Raises ServiceError where a source is live, or cannot be read."""
    needed = {source for zone in config.zones if zone.id in zones for source in zone.sources}
    for name, table in config.sources.items():
        if name in needed and config.is_live(name):
            raise ServiceError(
                f"sources.{name} is live ({table.kind}), and only recorded sources have a history; name a zone that "
                "recordings feed with --zone (replay), or a file of recorded sources with --from (learn)"
            )
    now = {"pace": inf, "follow": False}
    """As fast as possible, and what is there."""
    unpaced = {
        name: table.model_copy(update={key: now[key] for key in now if key in type(table).model_fields})
        for name, table in config.sources.items()
        if name in needed
    }
    config = config.model_copy(update={"sources": config.sources | unpaced})
    sources = {name: config.build_source(name) for name in config.sources if name in needed}
    routers = {name: Router(name, [binding.id for binding in config.bindings(name)]) for name in sources}
    streams = {name: source.batches(start) for name, source in sources.items()}
    clocks = dict.fromkeys(streams, -inf)
    try:
        while clocks:
            name = min(clocks, key=lambda source: clocks[source])
            batch = await anext(streams[name], None)
            if batch is None or (end is not None and clocks[name] >= end):
                del clocks[name]
                for zone in routers[name].zones:
                    yield Delivery(zone, name, [], inf)
                continue
            if isfinite(batch.now):
                clocks[name] = batch.now
            for delivery in routers[name].split(batch):
                yield delivery
    except SourceError as error:
        raise ServiceError(str(error)) from error
    finally:
        for source in sources.values():
            await source.close()
