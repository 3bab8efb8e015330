"""What the commands share. Each imports what it needs when it runs: `--help` does not wait for the compiler."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from adapters.fields.numbers import read_number, read_whole, whole_in
from adapters.fields.times import ZoneMissing, parse_time
from adapters.fields.words import suggestion
from service.errors import ConfigError

if TYPE_CHECKING:
    from service.config.site import Config

Value = TypeVar("Value")

AddCommand = Callable[[str, Callable[[argparse.Namespace], int], str], argparse.ArgumentParser]
"""`add(name, command, text)`: a subparser with the options that every command has."""


def take_config(parser: argparse.ArgumentParser) -> None:
    """Let the command take a configuration file, which `load_config` then reads."""
    parser.add_argument("config", type=Path, metavar="CONFIG", help="the configuration file (TOML)")


def load_config(arguments: argparse.Namespace, path: Path | None = None) -> Config:
    """The configuration that the command was given, or that at `path`, with every --set applied. Raises ConfigError."""
    from service.config.load import load

    return load(path or arguments.config, arguments.overrides)


def take_reset(parser: argparse.ArgumentParser) -> None:
    """Add --reset, the zones that begin anew; `require_zones` looks whether they exist."""
    meaning = "start these zones without their stored state, which is set aside; comes after CONFIG"
    parser.add_argument("--reset", nargs="+", default=[], action="extend", metavar="ZONE", help=meaning)


def require_zones(config: Config, wanted: Sequence[str], option: str) -> None:
    """Raise ConfigError if one of the zones that `option` names does not exist."""
    require(wanted, [zone.id for zone in config.zones], option, "zone")


def require(wanted: Sequence[str], known: Collection[str], option: str, noun: str) -> None:
    """Raise ConfigError if one of the things, each a `noun`, that `option` names is not `known`."""
    wrong = [(name, suggestion(name, known, f"the {noun}s are")) for name in wanted if name not in known]
    if wrong:
        raise ConfigError([f'{option}: there is no {noun} "{name}"; {near}' for name, near in wrong])


def checked(read: Callable[[str], Value | None], sentence: str) -> Callable[[str], Value]:
    """What takes the texts of which `read` makes something, and gives that; of any other it says the `sentence`."""

    def parse(text: str) -> Value:
        if (value := read(text)) is None:
            raise argparse.ArgumentTypeError(f"{text!r} {sentence}")
        return value

    return parse


def whole(lower: int, upper: int) -> Callable[[str], int]:
    """A reader of whole numbers from `lower` to `upper`."""
    return checked(
        lambda text: whole_in(read_whole(text), lower, upper), f"is not a whole number from {lower} to {upper}"
    )


def whole_range(lower: int, upper: int) -> Callable[[str], tuple[int, int]]:
    """A reader of a whole number, or of a range "first-last" of them, from `lower` to `upper`."""

    def ends(text: str) -> tuple[int, int] | None:
        first, _, last = text.partition("-")
        begin, end = read_whole(first), read_whole(last or first)
        return None if begin is None or end is None or not lower <= begin <= end <= upper else (begin, end)

    return checked(ends, f'is no range of whole numbers from {lower} to {upper}, such as "1-10"')


def _within(text: str, lower: float, upper: float = math.inf) -> float | None:
    value = read_number(text)
    return value if value is not None and lower <= value <= upper else None


def number(lower: float, upper: float) -> Callable[[str], float]:
    """A reader of numbers from `lower` to `upper`."""
    return checked(lambda text: _within(text, lower, upper), f"is not a number from {lower:g} to {upper:g}")


positive = checked(lambda text: _within(text, 0.0) or None, "is not a number above 0")
"""A reader of finite numbers above 0."""


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
