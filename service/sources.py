"""The kinds of source there are, and sources built from the configuration. A new kind is one entry in SOURCE_KINDS."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import inf
from typing import NamedTuple

from adapters.csv_source import CsvChannel, CsvSource
from adapters.units import conversion, default_valid_range
from service.config_models import ChannelConfig, Config, CsvConfig
from service.networks import build_network


class Binding(NamedTuple):
    """What a source delivers to one channel: the id of its readings ("zone/channel"), and the network's unit for it."""

    id: str
    channel: ChannelConfig
    unit: str


class SourceKind(NamedTuple):
    """The table that describes a source of this kind, and how to build one from its name, table and bindings."""

    table: type[CsvConfig]
    build: Callable[[str, CsvConfig, Sequence[Binding]], CsvSource]


def build_source(name: str, config: Config) -> CsvSource:
    """The source of the table [sources.`name`], delivering to every channel of every zone that names it."""
    table = config.sources[name]
    return SOURCE_KINDS[table.kind].build(name, table, list(_bindings(name, config)))


def _bindings(name: str, config: Config) -> Iterable[Binding]:
    for zone in config.zones:
        network = build_network(zone)
        for channel, table in zone.channels.items():
            if table.source == name:
                yield Binding(f"{zone.id}/{channel}", table, network.channel_unit(channel))


def _build_csv(name: str, table: CsvConfig, bindings: Sequence[Binding]) -> CsvSource:
    return CsvSource(
        name,
        table.files,
        [_csv_channel(binding) for binding in bindings],
        timestamp_column=table.timestamp.column,
        timestamp_format=table.timestamp.format,
        zone=table.timestamp.zone,
        delimiter=table.delimiter,
        decimal=table.decimal,
        encoding=table.encoding,
        pace=None if table.pace == inf else table.pace,
    )


def _csv_channel(binding: Binding) -> CsvChannel:
    channel = binding.channel
    return CsvChannel(
        binding.id,
        channel.source_columns,
        channel.scale,
        channel.offset,
        conversion(channel.unit, binding.unit),
        channel.valid or default_valid_range(binding.unit),
    )


SOURCE_KINDS: dict[str, SourceKind] = {"csv": SourceKind(CsvConfig, _build_csv)}
