"""Sources and their channels, built from tables as a configuration builds them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import inf
from pathlib import Path
from typing import Any

from adapters.channel import Binding, SourceConfig
from adapters.kinds import SOURCE_KINDS


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
