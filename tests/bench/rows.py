"""A row of the bench, how much of everything a run measures, and times as a person reads them."""

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

Result = TypeVar("Result")


class Row(NamedTuple):
    """What is measured, what is wanted, the measured figure as text, and whether it is what is wanted; None where
    nothing particular is wanted."""

    what: str
    target: str
    measured: str
    met: bool | None


class Sizes(NamedTuple):
    """Counts of a run; `particles` is N of every row that does not vary it."""

    particles: int = 9000
    settle: int = 300
    """Samples before anything is measured: the filter has found its way by then."""
    repeats: int = 600
    """Updates that are timed, one by one; the NumPy oracle is timed on every tenth."""
    particle_counts: tuple[int, ...] = (1000, 3000, 10_000, 30_000, 100_000)
    zone_counts: tuple[int, ...] = (1, 10, 100, 1000)
    growth_repeats: int = 30
    replay_samples: int = 22_172
    resident_zones: tuple[int, ...] = (1, 50, 100, 200, 400, 700, 1000)
    fleet: tuple[int, int, float, int] = (1000, 9000, 10.0, 6)
    """Zones, particles, s between two instants, and instants."""


SIZES = {"full": Sizes(), "tiny": Sizes(200, 5, 10, (100, 200, 400), (1, 2, 4), 3, 144, (1, 2, 4), (20, 60, 0.5, 3))}
"""Tiny: for the test that the measurements run; its figures mean nothing."""


def timed(work: Callable[[], Result]) -> tuple[float, Result]:
    """Seconds that `work` takes, and what it returns."""
    began = time.perf_counter()
    result = work()
    return time.perf_counter() - began, result


def text(seconds: float | None) -> str:
    """A time as a person reads it."""
    return "none" if seconds is None else f"{seconds:.3g} s" if seconds >= 1.0 else f"{1e3 * seconds:.3g} ms"


def spread(seconds: Sequence[float]) -> str:
    """Median and quartiles."""
    lower, middle, upper = np.quantile(seconds, (0.25, 0.5, 0.75)).tolist()
    return f"{text(middle)} ({text(lower)} to {text(upper)})"


def growth(what: str, size: str, values: Sequence[tuple[int, float]]) -> Row:
    """Whether `values` by size grow linearly: p of value ~ size^p, by least squares on logarithms."""
    sizes, seconds = zip(*values, strict=True)
    p = float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])
    return Row(f"{what} ~ {size}^p", "linear", f"p = {p:.2f} from {sizes[0]:,} to {sizes[-1]:,}", p <= 1.1)
