"""How far a command is, with the time that is left, in a terminal and once it takes long enough to ask."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar

from tqdm import tqdm

Result = TypeVar("Result")

_LOOK = 0.2
"""s between two looks at what is waited for."""

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


class Waiting(Protocol):
    """Awaits one of several things, each of which takes a set time at most."""

    async def __call__(self, awaited: Awaitable[Result]) -> Result:
        """What `awaited` gives."""


@contextmanager
def waiting_for(what: str, count: int, seconds: float) -> Iterator[Waiting]:
    """What awaits `count` things one after the other, each of `seconds` at most, and shows how much time is left."""
    form = "{desc}: {percentage:3.0f}%|{bar}| at most {remaining} left"
    watched = sys.stderr.isatty()
    with tqdm(desc=what, total=count * seconds, bar_format=form, delay=_SLOW, leave=False, disable=not watched) as bar:

        async def awaiting(awaited: Awaitable[Result]) -> Result:
            task, began, before = asyncio.ensure_future(awaited), time.monotonic(), bar.n
            try:
                while not (await asyncio.wait([task], timeout=_LOOK))[0]:
                    bar.update(before + min(time.monotonic() - began, seconds) - bar.n)
                return task.result()
            finally:
                task.cancel()
                # What did not take its time leaves the rest less.
                bar.total -= max(0.0, before + seconds - bar.n) if not bar.disable else 0.0
                bar.clear()

        yield awaiting
