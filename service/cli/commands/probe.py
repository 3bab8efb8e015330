"""`thermogate probe`: one look at every channel, for the person who connects a plant."""

from __future__ import annotations

import argparse
import asyncio
import sys
import time
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from service.cli.arguments import AddCommand, load_config, take_config
from service.fields.numbers import read_number

if TYPE_CHECKING:
    from adapters.reading import Probe
    from service.config.site import Config

LISTEN_SECONDS = 5.0


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


def _seconds(text: str) -> float:
    seconds = read_number(text)
    if seconds is None or not 0 < seconds <= 3600:
        raise argparse.ArgumentTypeError(f'must be a number of seconds above 0 and up to 3600, not "{text}"')
    return seconds


def _probe(arguments: argparse.Namespace) -> int:
    from service.errors import ConfigError
    from service.fields.words import suggestion

    config = load_config(arguments)
    wanted = arguments.source
    if wanted is not None and wanted not in config.sources:
        known = suggestion(wanted, config.sources, "the sources are")
        raise ConfigError([f'--source: there is no source "{wanted}"; {known}'])
    used = [name for name in config.sources if config.zones_of(name)]
    names = used if wanted is None else [wanted]
    return asyncio.run(_probe_all(config, names, arguments.seconds))


async def _probe_all(config: Config, names: Iterable[str], seconds: float) -> int:
    """Probe one source after the other, so that one that is not there does not hide the rest."""
    from adapters.errors import SourceError

    good = True
    for name in names:
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


def probe_table(probes: Iterable[Probe], units: Mapping[str, str], now: float) -> list[str]:
    """One line per probe, and under it what its raw value might also mean.

    `units` are the network's, by channel; `now` is UTC s.
    """
    from service.cli.tables import aligned

    rows = [("channel", "where", "raw", "value", "unit", "age", "verdict")]
    below: list[tuple[str, ...]] = [()]
    for probe in probes:
        value = "-" if probe.value is None else f"{probe.value:.6g}"
        age = "-" if probe.time is None else _age(now - probe.time)
        rows.append((probe.channel, probe.place, probe.raw, value, units[probe.channel], age, probe.verdict))
        below.append(probe.hints)
    lines = zip(aligned(rows), below, strict=True)
    return [line for row, hints in lines for line in (row, *(f"    {hint}" for hint in hints))]


def _age(seconds: float) -> str:
    """An age in the unit that suits it."""
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{max(seconds, 0.0):.1f} s"
