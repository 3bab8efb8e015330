"""Options of a command as a table."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import Any

Option = tuple[Callable[[str], Any], str, str, str]
"""How its text is read, its default as text, what stands for a value, and what it means."""


def add_options(parser: argparse.ArgumentParser, options: Mapping[str, Option]) -> None:
    """Add `options` by name."""
    for option, (read, default, value, meaning) in options.items():
        parser.add_argument(option, type=read, default=default, metavar=value, help=f"{meaning} (default %(default)s)")
