"""Options of a command as a table."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import Any

Option = tuple[Callable[[str], Any], str, str, str]
"""How its text is read, its default as text, what stands for a value, and what it means."""


def add_options(parser: argparse.ArgumentParser, options: Mapping[str, Option], **names: str) -> None:
    """Add `options` by name; `names` are those that the parsed arguments have under another name."""
    for option, (read, default, value, meaning) in options.items():
        name = option.removeprefix("--").replace("-", "_")
        parser.add_argument(
            option,
            type=read,
            default=default,
            dest=names.get(name, name),
            metavar=value,
            help=f"{meaning} (default %(default)s)",
        )
