"""The kinds of source there are, and sources built from the configuration. A new kind is one entry in SOURCE_KINDS."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import inf
from typing import Any, NamedTuple

from adapters.csv_source import CsvChannel, CsvSource
from adapters.edge import Edge
from adapters.reading import Source
from adapters.units import ENERGIES, conversion, default_valid_range
from service.config_models import ChannelConfig, Config, SourceConfig, ZoneConfig
from service.networks import build_network
from service.source_models import CsvChannelConfig, CsvConfig


class Binding(NamedTuple):
    """What a source delivers to one channel: the id of its readings ("zone/channel"), and the network's unit for it."""

    id: str
    channel: Any
    """The channel's table, of the model that belongs to the kind of source."""
    unit: str


class SourceKind(NamedTuple):
    """The table that describes a source of this kind, the one that describes a channel of it, and how to build one from
    its name, table and bindings. A `live` source tells what is now, a recorded one what was. `example` is how a channel
    says where its value is found."""

    table: type[SourceConfig]
    channel: type[ChannelConfig]
    live: bool
    example: str
    build: Callable[[str, Any, Sequence[Binding]], Source]


def build_source(name: str, config: Config) -> Source:
    """The source of the table [sources.`name`], delivering to every channel of every zone that names it."""
    table = config.sources[name]
    return SOURCE_KINDS[table.kind].build(name, table, list(bindings(name, config)))


def bindings(name: str, config: Config) -> Iterable[Binding]:
    """Every channel that the source `name` delivers to."""
    for zone in config.zones:
        network = build_network(zone)
        for channel, table in zone.channels.items():
            if table.source == name:
                yield Binding(f"{zone.id}/{channel}", table, network.channel_unit(channel))


def is_live(zone: ZoneConfig, config: Config) -> bool:
    """Whether the sources of `zone` are live; they are all live or all recorded."""
    return any(SOURCE_KINDS[config.sources[table.source].kind].live for table in zone.channels.values())


def edge_of(channel: ChannelConfig, unit: str, rollover: float | None = None) -> Edge:
    """How raw values of `channel` become values in the network's `unit`; a counter that does not say otherwise starts
    again at `rollover`."""
    energy = channel.unit in ENERGIES and channel.unit != unit
    amounts = energy and channel.aggregate == "energy"
    return Edge(
        channel.scale,
        channel.offset,
        conversion(channel.unit, unit, channel.nominal),
        (-inf, inf) if amounts else channel.valid or default_valid_range(unit),
        counter=energy and not amounts,
        rollover=channel.rollover or rollover,
    )


def _build_csv(name: str, table: CsvConfig, bindings: Sequence[Binding]) -> CsvSource:
    return CsvSource(
        name,
        table.files,
        [_csv_channel(binding.id, binding.channel, binding.unit) for binding in bindings],
        timestamp_column=table.timestamp.column,
        timestamp_format=table.timestamp.format,
        zone=table.timestamp.zone,
        delimiter=table.delimiter,
        decimal=table.decimal,
        encoding=table.encoding,
        pace=None if table.pace == inf else table.pace,
    )


def _csv_channel(id: str, channel: CsvChannelConfig, unit: str) -> CsvChannel:
    return CsvChannel(id, channel.source_columns, edge_of(channel, unit))


SOURCE_KINDS: dict[str, SourceKind] = {
    "csv": SourceKind(CsvConfig, CsvChannelConfig, False, 'column = "..."', _build_csv)
}
