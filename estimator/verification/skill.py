"""How forecasts have turned out: sums by the hour, kept for thirty days, and the scores of any window in them."""

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from estimator.arrays import Array, Indices

HOURS = 720
"""Hours that are kept: thirty days."""

Sums = npt.NDArray[np.float32]


class SkillBook(NamedTuple):
    """Verified forecasts of H horizons, hour by hour: sums of F quantities, of which the first is their number."""

    hours: Indices
    """(HOURS,): which hour since 1970 each row is about; -1 where it is about none."""
    sums: Sums
    """(HOURS, H, F)."""


class Scores(NamedTuple):
    """What a window says of H horizons. Arrays have shape (H,), NaN where nothing was verified.

    A book holds the same of each hour in this order, as sums: of an RMSE squared errors [K^2].
    """

    forecasts: Array
    """How many."""
    rmse: Array
    crps: Array
    """K."""
    coverage: Array
    width: Array
    """K."""
    persistence_rmse: Array
    arx_rmse: Array
    """K."""


class IssuedScores(NamedTuple):
    """As `Scores`, of forecasts as they were issued."""

    forecasts: Array
    rmse: Array
    crps: Array
    coverage: Array
    width: Array
    persistence_rmse: Array
    yesterday_rmse: Array
    """Of the same time a day before [K]."""
    persistence_crps: Array
    """The absolute error of a number without a spread [K]."""
    yesterday_crps: Array
    """K."""


Told = TypeVar("Told", Scores, IssuedScores)


def empty_book(horizons: int, told: type[Scores | IssuedScores] = Scores) -> SkillBook:
    """Nothing has been verified of `horizons`, of which these scores are to be `told`."""
    return SkillBook(
        np.full(HOURS, -1, dtype=np.int64), np.zeros((HOURS, horizons, len(told._fields)), dtype=np.float32)
    )


def noted(book: SkillBook, hour: int, horizon: int, values: tuple[float, ...]) -> SkillBook:
    """`book` with one more verified forecast of `horizon`, whose `values` are the book's fields without the number."""
    row = hour % HOURS
    hours, sums = book.hours, book.sums.copy()
    if hours[row] != hour:
        hours = hours.copy()
        hours[row], sums[row] = hour, 0.0
    sums[row, horizon] += np.array([1.0, *values], dtype=np.float32)
    return SkillBook(hours, sums)


def worth(y: float, mean: float, crps: float, interval: Sequence[float], *others: float) -> tuple[float, ...]:
    """What a forecast of `y` by its mean, CRPS and interval was worth beside what `others` said, in the order of Scores
    without the number."""
    lower, upper = interval
    errors = ((y - other) ** 2 for other in others)
    return ((y - mean) ** 2, crps, float(lower <= y <= upper), upper - lower, *errors)


def scores(told: type[Told], book: SkillBook, until: int, window: int) -> Told:
    """The scores of the last `window` hours up to and with the hour `until`."""
    within = (book.hours > until - window) & (book.hours <= until)
    total = book.sums[within].sum(axis=0, dtype=np.float64)
    count = total[:, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / np.where(count > 0.0, count, np.nan)[:, None]
    named = zip(told._fields[1:], mean[:, 1:].T, strict=True)
    return told(count, *(np.sqrt(column) if name.endswith("rmse") else column for name, column in named))
