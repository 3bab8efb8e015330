"""`thermogate probe`: one look at every channel, for the person who connects a plant."""

from __future__ import annotations

import argparse
import asyncio
import sys
import time
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from adapters.fields.numbers import read_number
from service.cli.arguments import AddCommand, load_config, require, take_config, whole_range

if TYPE_CHECKING:
    from adapters.reading import Probe, Source
    from adapters.scanning import Scan

LISTEN_SECONDS = 5.0
_SLOW = 2.0
"""s after which a terminal shows how far it is."""
_LARGEST_DEVICE = 4194302


def add_to(add: AddCommand) -> None:
    parser = add(
        "probe", _probe, "Read every channel once and show its value; exit code 0 if all are good, 1 otherwise."
    )
    take_config(parser)
    parser.add_argument("--source", metavar="NAME", help="the channels of this source only (default: all)")
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
    scan.add_argument("--tables", type=_tables, metavar="T,T", help="which tables (Modbus, default: holding,input)")


def _seconds(text: str) -> float:
    seconds = read_number(text)
    if seconds is None or not 0 < seconds <= 3600:
        raise argparse.ArgumentTypeError(f'must be a number of seconds above 0 and up to 3600, not "{text}"')
    return seconds


def _tables(text: str) -> tuple[str, ...]:
    from adapters.modbus.codec import TABLES

    chosen = tuple(dict.fromkeys(part.strip() for part in text.split(",")))
    if not set(chosen) <= set(TABLES):
        raise argparse.ArgumentTypeError(f"{text!r} is no list of tables; they are {', '.join(TABLES)}")
    return chosen


def _probe(arguments: argparse.Namespace) -> int:
    from adapters.scanning import Scan
    from service.config.load import load_sources
    from service.errors import ConfigError

    if not arguments.scan:
        for option in ("devices", "registers", "tables"):
            if getattr(arguments, option) is not None:
                raise ConfigError([f"--{option} says what to scan; give --scan too"])
    config = None if arguments.scan else load_config(arguments)
    # A scan comes before there are zones.
    tables = load_sources(arguments.config, arguments.overrides) if config is None else config.sources
    asked = [] if arguments.source is None else [arguments.source]
    require(asked, tables, "--source", "source")
    described = {name: table.described for name, table in tables.items()}
    if config is not None:
        units = {name: {one.id: one.unit for one in config.bindings(name)} for name in tables}

        async def probe(name: str, source: Source) -> bool:
            probes = await source.probe(arguments.seconds)
            lines = probe_table(probes, units[name], time.time())
            print("\n".join([f"source {name}: {described[name]}", *lines]))
            return all(one.verdict == "good" for one in probes)

        used = [name for name in tables if config.zones_of(name)]
        return 0 if all(asyncio.run(_looked("probe", asked or used, config.build_source, probe))) else 1
    wanted = Scan(arguments.devices, arguments.registers, arguments.tables or Scan().tables, arguments.seconds)

    async def scan(name: str, source: Source) -> bool | None:
        if await _scanned(source, f"source {name}: {described[name]}", wanted):
            return True
        if asked:
            print(f"thermogate: a source of kind {tables[name].kind} cannot be scanned", file=sys.stderr)
        return None

    found = asyncio.run(_looked("scan", asked or list(tables), lambda name: tables[name].build(name, []), scan))
    if set(found) == {None} and not asked:
        kinds = "there is no source that can be scanned; those of kind modbus, bacnet, mqtt and opcua can"
        print(f"thermogate: {kinds}", file=sys.stderr)
    return 0 if any(found) and False not in found else 1


async def _looked(
    what: str,
    names: Sequence[str],
    build: Callable[[str], Source],
    look: Callable[[str, Source], Awaitable[bool | None]],
) -> list[bool | None]:
    """What each `look` at a source says, one source after the other; False for one that is not there."""
    from tqdm import tqdm

    from adapters.errors import SourceError

    found = []
    for name in tqdm(names, what, unit=" sources", delay=_SLOW, leave=False, disable=not sys.stderr.isatty()):
        source = build(name)
        try:
            found.append(await look(name, source))
        except SourceError as error:
            print(f"thermogate: {error}", file=sys.stderr)
            found.append(False)
        finally:
            await source.close()
    return found


async def _scanned(source: Source, title: str, wanted: Scan) -> bool:
    """Show what there is under a `title`; False for a source that cannot be scanned."""
    from adapters.scanning import Scannable
    from service.cli.tables import aligned
    from service.errors import one_line

    if not isinstance(source, Scannable):
        return False
    found = await source.scan(wanted)
    lines = aligned(found.rows) if len(found.rows) > 1 else []
    print("\n".join([title, *lines, *map(one_line, found.remarks)]))
    return True


def probe_table(probes: Iterable[Probe], units: Mapping[str, str], now: float) -> list[str]:
    """A line per probe, and under it what its raw value might also mean; `units` are the network's, `now` is UTC s."""
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
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{max(seconds, 0.0):.1f} s"
