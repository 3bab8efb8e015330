"""The kinds of source there are, and sources built from the configuration. A new kind is one entry in SOURCE_KINDS."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from math import inf
from typing import Any, NamedTuple

from adapters.csv_source import CsvChannel, CsvSource
from adapters.edge import Edge
from adapters.modbus_client import Line
from adapters.modbus_plan import Limits
from adapters.modbus_source import ModbusChannel, ModbusSource
from adapters.reading import Source
from adapters.units import ENERGIES, conversion, default_valid_range
from adapters.zenoh_points import Dating, ZenohChannel
from adapters.zenoh_source import Intake, ZenohSource
from service.config_models import ChannelConfig, Config, ZoneConfig
from service.modbus_models import ModbusChannelConfig, ModbusConfig
from service.networks import build_network
from service.source_models import CsvChannelConfig, CsvConfig
from service.zenoh_models import ZenohChannelConfig, ZenohSourceConfig


class Binding(NamedTuple):
    """What a source delivers to one channel: the id of its readings ("zone/channel"), and the network's unit for it."""

    id: str
    channel: Any
    """The channel's table, of the model that belongs to the kind of source."""
    unit: str


class SourceKind(NamedTuple):
    """The table that describes a source of this kind, the one that describes a channel of it, and how to build one from
    its name, table and bindings. A `live` source tells what is now, a recorded one what was. `example` is how a channel
    says where its value is found. `rebind` gives a live source that is at work other bindings."""

    table: type[Any]
    channel: type[ChannelConfig]
    live: bool
    example: str
    build: Callable[[str, Any, Sequence[Binding]], Source]
    rebind: Callable[[Any, Any, Sequence[Binding]], None] | None = None


def build_source(name: str, config: Config) -> Source:
    """The source of the table [sources.`name`], delivering to every channel of every zone that names it."""
    table = config.sources[name]
    return SOURCE_KINDS[table.kind].build(name, table, list(bindings(name, config)))


def rebind_source(source: Source, name: str, config: Config) -> None:
    """Let a live `source`, built from the same table, deliver to the channels in `config` from now on."""
    table = config.sources[name]
    rebind = SOURCE_KINDS[table.kind].rebind
    assert rebind is not None, f"a source of kind {table.kind} is built anew"
    rebind(source, table, list(bindings(name, config)))


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


def pace_of(zone: ZoneConfig, config: Config) -> float:
    """How many times faster than the real time the telemetry of `zone` comes: 1 if it is live."""
    tables = [config.sources[table.source] for table in zone.channels.values()]
    return min((table.pace if isinstance(table, CsvConfig) else 1.0 for table in tables), default=1.0)


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


def _build_modbus(name: str, table: ModbusConfig, bindings: Sequence[Binding]) -> ModbusSource:
    line = Line(
        transport=table.transport,
        host=table.host or "",
        port=table.port,
        timeout=table.timeout,
        retries=table.retries,
        pause=table.pause,
    )
    if table.serial is not None:
        line = replace(
            line,
            device=table.serial.device,
            baudrate=table.serial.baudrate,
            parity=table.serial.parity[0].upper(),
            data_bits=table.serial.data_bits,
            stop_bits=table.serial.stop_bits,
        )
    return ModbusSource(
        name,
        line,
        [_modbus_channel(binding.id, binding.channel, binding.unit, table) for binding in bindings],
        poll=table.poll,
        limits=Limits(table.batch, table.max_registers, table.fill_gaps),
    )


def _rebind_modbus(source: ModbusSource, table: ModbusConfig, bindings: Sequence[Binding]) -> None:
    source.rebind([_modbus_channel(binding.id, binding.channel, binding.unit, table) for binding in bindings])


def _modbus_channel(id: str, channel: ModbusChannelConfig, unit: str, table: ModbusConfig) -> ModbusChannel:
    assert channel.unit_id is not None
    assert channel.table is not None
    return ModbusChannel(
        id,
        channel.register - table.first_register,
        channel.format,
        unit=channel.unit_id,
        table=channel.table,
        edge=edge_of(channel, unit, channel.format.rollover),
        stuck_after=channel.stuck_after,
        register=channel.register,
    )


def _build_zenoh(name: str, table: ZenohSourceConfig, bindings: Sequence[Binding]) -> ZenohSource:
    return ZenohSource(
        name,
        table.connection,
        [_zenoh_channel(binding.id, binding.channel, binding.unit) for binding in bindings],
        Intake(Dating(table.times, table.max_ahead), table.recover, table.queue, table.longest_stretch),
    )


def _rebind_zenoh(source: ZenohSource, table: ZenohSourceConfig, bindings: Sequence[Binding]) -> None:
    source.rebind([_zenoh_channel(binding.id, binding.channel, binding.unit) for binding in bindings])


def _zenoh_channel(id: str, channel: ZenohChannelConfig, unit: str) -> ZenohChannel:
    return ZenohChannel(id, channel.key, channel.payload_format, edge_of(channel, unit), channel.stuck_after)


SOURCE_KINDS: dict[str, SourceKind] = {
    "csv": SourceKind(CsvConfig, CsvChannelConfig, False, 'column = "..."', _build_csv),
    "modbus": SourceKind(
        ModbusConfig, ModbusChannelConfig, True, 'register = 0, type = "float32"', _build_modbus, _rebind_modbus
    ),
    "zenoh": SourceKind(ZenohSourceConfig, ZenohChannelConfig, True, 'key = "..."', _build_zenoh, _rebind_zenoh),
}
