"""`thermogate probe`: one look at every channel, for the person who connects a plant."""

from __future__ import annotations

import argparse
import asyncio
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from adapters.fields.numbers import read_number
from service.cli.arguments import AddCommand, load_config, load_source_tables, take_config, whole_range

if TYPE_CHECKING:
    from adapters.channel import SourceConfig
    from adapters.reading import Probe
    from adapters.scanning import Scan
    from service.config.site import Config

LISTEN_SECONDS = 5.0

_LARGEST_DEVICE = 4194302


def add_to(add: AddCommand) -> None:
    """Add the command by `add(name, command, text)`."""
    parser = add("probe", _probe, "Read every channel once and show what is made of it; 0 if all is good, 1 otherwise.")
    take_config(parser)
    parser.add_argument("--source", metavar="NAME", help="look at the channels of this source only (default: all)")
    parser.add_argument(
        "--seconds",
        type=_seconds,
        default=LISTEN_SECONDS,
        metavar="S",
        help=f"how long to listen to a source that publishes by itself, at most (default: {LISTEN_SECONDS:g})",
    )
    scan = parser.add_argument_group("scan", "list what there is to read, reading only; needs no zones yet")
    scan.add_argument(
        "--scan",
        action="store_true",
        help="list registers (Modbus), devices and objects (BACnet), topics (MQTT) or variables (OPC UA)",
    )
    scan.add_argument(
        "--devices",
        type=whole_range(0, _LARGEST_DEVICE),
        metavar="A-B",
        help="unit ids (Modbus, default: the source's unit_id) or device instances (BACnet, default: all)",
    )
    scan.add_argument(
        "--registers",
        type=whole_range(0, 65536),
        metavar="A-B",
        help="registers, as the source counts them (Modbus, default: the first 100)",
    )
    scan.add_argument(
        "--tables",
        type=_tables,
        metavar="T,T",
        help="which tables (Modbus, default: holding,input)",
    )


def _seconds(text: str) -> float:
    seconds = read_number(text)
    if seconds is None or not 0 < seconds <= 3600:
        raise argparse.ArgumentTypeError(f'must be a number of seconds above 0 and up to 3600, not "{text}"')
    return seconds


def _tables(text: str) -> tuple[str, ...]:
    from adapters.modbus.plan import TABLES

    chosen = tuple(dict.fromkeys(part.strip() for part in text.split(",")))
    if not set(chosen) <= set(TABLES):
        raise argparse.ArgumentTypeError(f"{text!r} is no list of tables; they are {', '.join(TABLES)}")
    return chosen


def _probe(arguments: argparse.Namespace) -> int:
    from adapters.fields.words import suggestion
    from adapters.scanning import Scan
    from service.errors import ConfigError

    for option in ("devices", "registers", "tables"):
        if getattr(arguments, option) is not None and not arguments.scan:
            raise ConfigError([f"--{option} says what to scan; give --scan too"])
    config = None if arguments.scan else load_config(arguments)
    sources = load_source_tables(arguments) if config is None else config.sources
    wanted = arguments.source
    if wanted is not None and wanted not in sources:
        known = suggestion(wanted, sources, "the sources are")
        raise ConfigError([f'--source: there is no source "{wanted}"; {known}'])
    if config is not None:
        used = [name for name in sources if config.zones_of(name)]
        return asyncio.run(_probe_all(config, used if wanted is None else [wanted], arguments.seconds))
    names = list(sources) if wanted is None else [wanted]
    tables = arguments.tables or Scan().tables
    scan = Scan(arguments.devices, arguments.registers, tables, arguments.seconds)
    return asyncio.run(_scan_all({name: sources[name] for name in names}, scan, asked=wanted is not None))


async def _probe_all(config: Config, names: Sequence[str], seconds: float) -> int:
    """Probe one source after the other, so that one that is not there does not hide the rest."""
    from adapters.errors import SourceError
    from service.cli.progress import sources_done

    good = True
    for name in sources_done("probe", names):
        source = config.build_source(name)
        try:
            probes = await source.probe(seconds)
        except SourceError as error:
            print(f"thermogate: {error}", file=sys.stderr)
            good = False
            continue
        finally:
            await source.close()
        units = {binding.id: binding.unit for binding in config.bindings(name)}
        print("\n".join([f"source {name}: {config.sources[name].described}", *probe_table(probes, units, time.time())]))
        good &= all(probe.verdict == "good" for probe in probes)
    return 0 if good else 1


async def _scan_all(sources: Mapping[str, SourceConfig], wanted: Scan, *, asked: bool) -> int:
    """Scan one source after the other. One that cannot be scanned is an error only if it was `asked` for."""
    from adapters.errors import SourceError
    from adapters.scanning import Scannable
    from service.cli.tables import aligned
    from service.errors import one_line

    good, scanned = True, False
    for name, table in sources.items():
        source = table.build(name, ())
        try:
            if not isinstance(source, Scannable):
                if asked:
                    print(f"thermogate: a source of kind {table.kind} cannot be scanned", file=sys.stderr)
                    good = False
                continue
            scanned = True
            found = await source.scan(wanted)
        except SourceError as error:
            print(f"thermogate: {error}", file=sys.stderr)
            good = False
            continue
        finally:
            await source.close()
        lines = aligned(found.rows) if len(found.rows) > 1 else []
        print("\n".join([f"source {name}: {table.described}", *lines, *map(one_line, found.remarks)]))
    if not scanned and not asked:
        kinds = "there is no source that can be scanned; those of kind modbus, bacnet, mqtt and opcua can"
        print(f"thermogate: {kinds}", file=sys.stderr)
    return 0 if good and scanned else 1


def probe_table(probes: Iterable[Probe], units: Mapping[str, str], now: float) -> list[str]:
    """One line per probe, and under it what its raw value might also mean.

    `units` are the network's, by channel; `now` is UTC s.
    """
    from service.cli.tables import aligned
    from service.errors import one_line

    rows = [("channel", "where", "raw", "value", "unit", "age", "verdict")]
    below: list[tuple[str, ...]] = [()]
    for probe in probes:
        value = "-" if probe.value is None else f"{probe.value:.6g}"
        age = "-" if probe.time is None else _age(now - probe.time)
        rows.append((probe.channel, probe.place, probe.raw, value, units[probe.channel], age, probe.verdict))
        below.append(probe.hints)
    lines = zip(aligned(rows), below, strict=True)
    return [line for row, hints in lines for line in (row, *(f"    {one_line(hint)}" for hint in hints))]


def _age(seconds: float) -> str:
    """An age in the unit that suits it."""
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{max(seconds, 0.0):.1f} s"
