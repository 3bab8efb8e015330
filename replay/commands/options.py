"""Options that several commands have, and options as a table."""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from service.cli.arguments import instant
from service.errors import ConfigError

Option = tuple[Callable[[str], Any], str, str, str]
"""How its text is read, its default as text, what stands for a value, and what it means."""


def add_options(parser: argparse.ArgumentParser, options: Mapping[str, Option]) -> None:
    for option, (read, default, value, meaning) in options.items():
        parser.add_argument(option, type=read, default=default, metavar=value, help=f"{meaning} (default %(default)s)")


def take_report(parser: argparse.ArgumentParser, *, out: bool = True) -> None:
    """Let the command say in which language its report is, and where it goes."""
    parser.add_argument("--language", choices=("en", "de"), default="en", help="language of the report (default: en)")
    if out:
        parser.add_argument(
            "--out", type=Path, default=Path(), metavar="DIR", help="folder for report.html (default: here)"
        )


def take_period(parser: argparse.ArgumentParser) -> None:
    """Let the command take a part of a recording, which `check_period` looks at."""
    parser.add_argument("--start", type=instant, metavar="T", help="first time, RFC 3339, such as 2025-05-03T00:00:00Z")
    parser.add_argument("--end", type=instant, metavar="T", help="time to stop before, RFC 3339")


def check_period(arguments: argparse.Namespace) -> None:
    """ConfigError where the part has no length."""
    if arguments.start is not None and arguments.end is not None and arguments.start >= arguments.end:
        raise ConfigError(["--start is not before --end; swap or correct them"])
