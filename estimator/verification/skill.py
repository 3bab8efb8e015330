"""How forecasts have turned out: sums by the hour, kept for thirty days, and the scores of any window in them."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.arrays import Array, Indices

HOURS = 720
"""Hours that are kept: thirty days."""

FIELDS = ("forecasts", "square", "crps", "covered", "width", "persistence", "arx")
"""Sums over the verified forecasts of an hour: their number, squared errors [K^2], CRPS [K], how many the interval
covered, widths [K], squared errors of persistence and of the ARX model [K^2]."""

Sums = npt.NDArray[np.float32]


class SkillBook(NamedTuple):
    """Verified forecasts of H horizons, hour by hour: sums of F quantities, of which the first is their number."""

    hours: Indices
    """(HOURS,): which hour since 1970 each row is about; -1 where it is about none."""
    sums: Sums
    """(HOURS, H, F)."""


class Scores(NamedTuple):
    """What a window says of H horizons. Arrays have shape (H,), NaN where nothing was verified."""

    forecasts: Array
    coverage: Array
    crps: Array
    """K."""
    rmse: Array
    """K."""
    width: Array
    """K."""
    persistence_rmse: Array
    """K."""
    arx_rmse: Array
    """K."""


def empty_book(horizons: int, fields: int = len(FIELDS)) -> SkillBook:
    """Nothing has been verified of `horizons`, each of which has so many `fields`."""
    return SkillBook(np.full(HOURS, -1, dtype=np.int64), np.zeros((HOURS, horizons, fields), dtype=np.float32))


def noted(book: SkillBook, hour: int, horizon: int, values: tuple[float, ...]) -> SkillBook:
    """`book` with one more verified forecast of `horizon`, whose `values` are the book's fields without the number."""
    row = hour % HOURS
    hours, sums = book.hours, book.sums.copy()
    if hours[row] != hour:
        hours = hours.copy()
        hours[row], sums[row] = hour, 0.0
    sums[row, horizon] += np.array([1.0, *values], dtype=np.float32)
    return SkillBook(hours, sums)


def means(book: SkillBook, until: int, window: int) -> Array:
    """The number of forecasts and the means of the other fields, (F, H), over the last `window` hours up to and with
    the hour `until`; NaN where nothing was verified."""
    within = (book.hours > until - window) & (book.hours <= until)
    total = book.sums[within].sum(axis=0, dtype=np.float64)
    count = total[:, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / np.where(count > 0.0, count, np.nan)[:, None]
    return np.vstack([count, mean[:, 1:].T])


def scores(book: SkillBook, until: int, window: int) -> Scores:
    """The scores of the last `window` hours up to and with the hour `until`."""
    count, square, score, covered, width, persistence, arx = means(book, until, window)
    return Scores(
        forecasts=count,
        coverage=covered,
        crps=score,
        rmse=np.sqrt(square),
        width=width,
        persistence_rmse=np.sqrt(persistence),
        arx_rmse=np.sqrt(arx),
    )
