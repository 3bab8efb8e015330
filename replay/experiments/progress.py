"""How far an experiment is with what is no run: reading and simulating before the runs, scoring after them."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar, overload

from tqdm import tqdm

from replay.recorded.runner import SLOW

Item = TypeVar("Item")


def steps(items: Iterable[Item], what: str, total: int | None = None) -> Iterator[Item]:
    """`items`, while a terminal shows how many of `total` are done and how much time is left."""
    return iter(tqdm(items, desc=what, total=total, unit="", delay=SLOW, leave=False, disable=not sys.stderr.isatty()))


class Taken(Sequence[Item]):
    """A list of results, and a terminal shows how many of them have been taken from it: by then the others are done."""

    def __init__(self, items: Sequence[Item], what: str) -> None:
        self._items = items
        self._bar = tqdm(total=len(items), desc=what, unit="", delay=SLOW, leave=False, disable=not sys.stderr.isatty())

    def __len__(self) -> int:
        return len(self._items)

    @overload
    def __getitem__(self, place: int) -> Item: ...

    @overload
    def __getitem__(self, place: slice) -> Sequence[Item]: ...

    def __getitem__(self, place: int | slice) -> Item | Sequence[Item]:
        found = self._items[place]
        self._bar.update(len(self._items[place]) if isinstance(place, slice) else 1)
        return found

    def close(self) -> None:
        """All is scored."""
        self._bar.close()
