"""How far a command is, with the time that is left, in a terminal and once it takes long enough to ask."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager

from tqdm import tqdm

_SLOW = 2.0
"""s after which progress is shown."""


@contextmanager
def bytes_done(what: str) -> Iterator[Callable[[int, int], None]]:
    """A function that takes how many more bytes are done, and how many there are in all."""
    with tqdm(desc=what, unit="B", unit_scale=True, delay=_SLOW, disable=not sys.stderr.isatty()) as bar:

        def tick(more: int, total: int) -> None:
            bar.total = total
            bar.update(more)

        yield tick


def sources_done(what: str, names: Sequence[str]) -> Iterable[str]:
    """`names`, with how many of them are done."""
    bar: Iterable[str] = tqdm(names, what, unit=" sources", delay=_SLOW, leave=False, disable=not sys.stderr.isatty())
    return bar
