"""Sources and their channels, built from tables as a configuration builds them."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from contextlib import aclosing
from math import inf
from pathlib import Path
from typing import Any

from support.waiting import PATIENCE

from adapters.channel import Binding, SourceConfig
from adapters.kinds import SOURCE_KINDS
from adapters.reading import Batch


def source_table(kind: str, name: str = "bms", **keys: Any) -> Any:
    """The table [sources.`name`] of a `kind` with `keys`."""
    return SOURCE_KINDS[kind].model_validate(keys, context={"folder": Path("/"), "site": None, "source": name})


def bound(
    table: SourceConfig, /, id: str, to: str | None = None, usual: tuple[float, float] = (-inf, inf), **keys: Any
) -> Binding:
    """What the source of `table` delivers to channel `id` ("zone/channel"), whose values are `usual`ly in a range; `to`
    is the network's unit, by default that of `keys`, the channel's own."""
    channel = table.channel.model_validate({"source": "bms", "unit": "1"} | keys).within(table)
    return Binding(id, channel, to or channel.unit, usual)


def recording(
    name: str, files: Sequence[Path], channels: Iterable[Mapping[str, Any]], column: str = "t", **keys: Any
) -> Any:
    """A source of CSV `files`, with the time in `column`; `format` and `zone` are those of the time."""
    stamp = {"column": column} | {key: keys.pop(key) for key in ("format", "zone") if key in keys}
    table = source_table("csv", files=list(files), timestamp=stamp, **keys)
    return table.build(name, [bound(table, **one) for one in channels])


def values(batches: Iterable[Batch]) -> dict[str, Any]:
    """The latest value of every channel, or its fault."""
    return {reading.channel: reading.fault or reading.value for batch in batches for reading in batch.readings}


def played(source: Any, start: float | None = None) -> list[Batch]:
    """All batches of a recorded `source`."""

    async def run() -> list[Batch]:
        return [batch async for batch in source.batches(start)]

    return asyncio.run(run())


def delivered(source: Any, start: float | None, begin: float) -> list[tuple[float, float | None]]:
    """Seconds since `begin` [UTC s] and value of all that a recorded `source` delivers, none ahead of its clock."""
    batches = played(source, start)
    assert all(reading.time <= batch.now for batch in batches for reading in batch.readings)
    return [(reading.time - begin, reading.value) for batch in batches for reading in batch.readings]


async def collect(source: Any, enough: Callable[[list[Batch]], object] = bool) -> list[Batch]:
    """Batches of `source` until they are `enough`; fails if that takes too long."""
    batches: list[Batch] = []
    async with asyncio.timeout(PATIENCE), aclosing(source.batches(None)) as stream:
        async for batch in stream:
            batches.append(batch)
            if enough(batches):
                break
    return batches


async def becomes(stream: AsyncIterator[Batch], expected: Mapping[str, Any]) -> dict[str, Any]:
    """Take what comes until every channel has the value, or the fault, that is `expected`; what all have then."""
    found: dict[str, Any] = {}
    async with asyncio.timeout(PATIENCE):
        while not found.items() >= expected.items():
            found |= values([await anext(stream)])
    return found


async def exhaust(stream: AsyncIterator[Batch], taken: list[Batch] | None = None) -> None:
    """Take everything that comes, into `taken` if there is such a list."""
    async with asyncio.timeout(PATIENCE):
        async for batch in stream:
            if taken is not None:
                taken.append(batch)
