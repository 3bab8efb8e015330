"""How far a command is, with the time that is left, in a terminal and once it takes long enough to ask."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

from tqdm import tqdm

_SLOW = 2.0
"""s after which progress is shown."""


def sources_done(what: str, names: Sequence[str]) -> Iterable[str]:
    """`names`, with how many of them are done."""
    bar: Iterable[str] = tqdm(names, what, unit=" sources", delay=_SLOW, leave=False, disable=not sys.stderr.isatty())
    return bar
