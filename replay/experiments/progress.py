"""How far an experiment is with what is no run: reading and simulating before the runs, scoring after them."""

import sys
from collections.abc import Iterable, Iterator
from typing import TypeVar

from tqdm import tqdm

from service.recordings.progress import SLOW

Item = TypeVar("Item")


def steps(items: Iterable[Item], what: str, total: int | None = None) -> Iterator[Item]:
    """`items`, while a terminal shows how many of `total` are done and how much time is left."""
    return iter(tqdm(items, desc=what, total=total, unit="", delay=SLOW, leave=False, disable=not sys.stderr.isatty()))
