"""What the commands share: how one is added, how its configuration, numbers and times are read.

A command imports what it needs when it runs, so that `thermogate --help` does not wait for the compiler.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from adapters.fields.numbers import read_number, read_whole
from adapters.fields.times import ZoneMissing, parse_time
from service.errors import ConfigError

if TYPE_CHECKING:
    from adapters.channel import SourceConfig
    from service.config.site import Config

AddCommand = Callable[[str, Callable[[argparse.Namespace], int], str], argparse.ArgumentParser]
"""`add(name, command, text)`: a subparser with the options that every command has."""


def take_config(parser: argparse.ArgumentParser) -> None:
    """Let the command take a configuration file, which `load_config` then reads."""
    parser.add_argument("config", type=Path, metavar="CONFIG", help="the configuration file (TOML)")


def load_config(arguments: argparse.Namespace, path: Path | None = None) -> Config:
    """The configuration that the command was given, or the one at `path`, with every --set applied. Raises
    ConfigError."""
    from service.config.load import load

    return load(path or arguments.config, arguments.overrides)


def load_source_tables(arguments: argparse.Namespace) -> dict[str, SourceConfig]:
    """The tables of the sources in the configuration that the command was given, which needs no zones for that. Raises
    ConfigError."""
    from service.config.load import load_sources

    return load_sources(arguments.config, arguments.overrides)


def require_zones(config: Config, wanted: Sequence[str], option: str) -> None:
    """Raise ConfigError if one of the zones that `option` names does not exist."""
    ids = [zone.id for zone in config.zones]
    unknown = [zone for zone in wanted if zone not in ids]
    if unknown:
        raise ConfigError([f'{option}: there is no zone "{zone}"; the zones are {", ".join(ids)}' for zone in unknown])


def whole(lower: int, upper: int) -> Callable[[str], int]:
    """A reader of whole numbers from `lower` to `upper`."""

    def parse(text: str) -> int:
        value = read_whole(text)
        if value is None or not lower <= value <= upper:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {lower} to {upper}")
        return value

    return parse


def whole_range(lower: int, upper: int) -> Callable[[str], tuple[int, int]]:
    """A reader of a whole number, or of a range "first-last" of them, from `lower` to `upper`."""

    def parse(text: str) -> tuple[int, int]:
        first, _, last = text.partition("-")
        begin, end = read_whole(first), read_whole(last or first)
        if begin is None or end is None or not lower <= begin <= end <= upper:
            raise argparse.ArgumentTypeError(
                f'{text!r} is no range of whole numbers from {lower} to {upper}, such as "1-10"'
            )
        return begin, end

    return parse


def number(lower: float, upper: float) -> Callable[[str], float]:
    """A reader of numbers from `lower` to `upper`."""

    def parse(text: str) -> float:
        value = read_number(text)
        if value is None or not lower <= value <= upper:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number from {lower:g} to {upper:g}")
        return value

    return parse


def positive(text: str) -> float:
    """A finite number above 0."""
    value = read_number(text)
    if value is None or not value > 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def instant(text: str) -> float:
    """UTC seconds of an RFC 3339 time."""
    try:
        return parse_time(text).timestamp()
    except ZoneMissing:
        raise argparse.ArgumentTypeError(
            f"{text!r} has no time zone; end it with Z for UTC or an offset such as +02:00, as in 2025-05-03T00:00:00Z"
        ) from None
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time; write it as 2025-05-03T00:00:00Z") from None
