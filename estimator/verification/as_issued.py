"""Forecasts hours ahead held to what came, as they were issued: with the inputs that were foreseen then.

The hindsight of `estimator.verification.verification` asks what a model is worth once the heating is known. This asks
what the published forecast was worth when nobody knew it. Once an hour the forecast that a client would have got is
kept, and scored when its time has come, beside persistence and the same time a day before.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from estimator.arrays import DAY, Array, Indices, together, under
from estimator.types import Mixture
from estimator.verification.hindsight import HORIZONS
from estimator.verification.scores import COMPONENTS, crps, reduced
from estimator.verification.skill import IssuedScores, SkillBook, empty_book, noted, scores, worth
from estimator.verification.verification import TAILS

_BOOK = "book."


class Waiting(NamedTuple):
    """M forecasts of the first output that wait for their time, each a mixture of at most C = COMPONENTS Gaussians."""

    step: Array
    """(): of the zone, counted from the first sample of its segment."""
    due: Indices
    """(M,): the step at which each one comes true."""
    horizon: Indices
    """(M,): its place among the horizons."""
    lower: Array
    """(M,): of its interval [degC]."""
    upper: Array
    """(M,)."""
    weights: Array
    """(M, C): 0 for a component that is not there."""
    means: Array
    """(M, C) [degC]."""
    sds: Array
    """(M, C) [K]."""


class Issued(NamedTuple):
    """What a zone knows of its forecasts as they were issued."""

    waiting: Waiting
    book: SkillBook


class AsIssued:
    """Verifies forecasts as they are issued, of an estimator with this `period` [s]. Every method is pure."""

    def __init__(self, period: float) -> None:
        leads = [round(horizon / period) for horizon in HORIZONS]
        # One step ahead the inputs are known, and the published forecast is scored as it is.
        self._leads = [lead for lead in leads if lead > 1]
        self._a_day = round(DAY / period)
        self.leads = tuple(round(lead * period) for lead in self._leads)
        """Of the horizons, from the last sample known to the one forecast [s]."""

    def start(self) -> Issued:
        """Before the first forecast."""
        return Issued(_nothing(), empty_book(len(self._leads), IssuedScores))

    def restart(self, issued: Issued) -> Issued:
        """The first sample after a gap: what was waiting has lost its time, what was verified is kept."""
        return issued._replace(waiting=_nothing())

    def update(self, issued: Issued, before: Array, y: float, time: int) -> Issued:
        """After the sample at `time` [UTC s], whose first output was `y`, NaN where it is missing; `before` (m,) are
        those of the samples before it in its segment, newest last."""
        waiting, book = issued
        if not (waiting.due <= waiting.step).any():
            return issued
        for row in np.flatnonzero(waiting.due == waiting.step).tolist():
            horizon = int(waiting.horizon[row])
            persistence = _back(before, self._leads[horizon])
            if np.isfinite(y) and np.isfinite(persistence):
                a_day_ago = _back(before, self._a_day)
                # On the first day there is none yet.
                yesterday = a_day_ago if np.isfinite(a_day_ago) else persistence
                book = noted(book, time // 3600, horizon, _values(waiting, row, y, persistence, yesterday))
        later = waiting.due > waiting.step
        return Issued(_changed(waiting, lambda name, rows: rows[later]), book)

    def predict(self, issued: Issued, futures: Callable[[Sequence[int]], Sequence[Mixture]] | None) -> Issued:
        """One period on. Where a forecast is issued, `futures` makes it at a number of leads, in steps from the last
        sample."""
        waiting = issued.waiting
        step = int(waiting.step) + 1
        waiting = waiting._replace(step=np.array(step))
        if futures is not None and self._leads:
            for horizon, (lead, mixture) in enumerate(zip(self._leads, futures(self._leads), strict=True)):
                waiting = _with(waiting, step + lead - 1, horizon, mixture)
        return issued._replace(waiting=waiting)

    def scores(self, issued: Issued, time: int, days: int) -> IssuedScores:
        """What the forecasts of the last `days` days up to the sample at `time` [UTC s] were worth, in arrays (H,)
        beside `leads`."""
        return scores(IssuedScores, issued.book, time // 3600, 24 * days)

    def pack(self, issued: Issued) -> dict[str, Array]:
        """Everything as arrays, by name."""
        return issued.waiting._asdict() | together({_BOOK: issued.book._asdict()})

    def unpack(self, arrays: Mapping[str, Array]) -> Issued:
        """What was packed, with the same bits; before the first forecast where nothing was."""
        if not arrays:
            return self.start()
        book = SkillBook(**under(_BOOK, arrays))
        return Issued(Waiting(*(arrays[name] for name in Waiting._fields)), book)  # type: ignore[arg-type]


def _nothing() -> Waiting:
    none, whole = np.zeros(0), np.zeros(0, dtype=np.int64)
    components = np.zeros((0, COMPONENTS))
    return Waiting(np.array(0), whole, whole, none, none, components, components, components)


def _with(waiting: Waiting, due: int, horizon: int, mixture: Mixture) -> Waiting:
    """`waiting` and the `mixture` of one more horizon."""
    lower, upper = mixture.quantiles(TAILS, 0).tolist()
    small = reduced(Mixture(mixture.weights, mixture.means[:1], mixture.sds[:1]), COMPONENTS)
    rows = np.zeros((3, COMPONENTS))
    # A component that is not there still has a spread to divide by.
    rows[2] = 1.0
    rows[:, : len(small.weights)] = small.weights / small.weights.sum(), small.means[0], small.sds[0]
    row: dict[str, Any] = {"due": due, "horizon": horizon, "lower": lower, "upper": upper}
    row |= {"weights": rows[0], "means": rows[1], "sds": rows[2]}
    return _changed(waiting, lambda name, column: np.concatenate([column, np.array([row[name]], dtype=column.dtype)]))


def _changed(waiting: Waiting, change: Callable[[str, Any], Any]) -> Waiting:
    """`waiting` with a `change` of each of its columns."""
    columns = {name: change(name, column) for name, column in waiting._asdict().items() if name != "step"}
    return waiting._replace(**columns)


def _values(waiting: Waiting, row: int, y: float, persistence: float, yesterday: float) -> tuple[float, ...]:
    """What a forecast of `y` was worth, by IssuedScores without the number."""
    there = waiting.weights[row] > 0.0
    mixture = Mixture(waiting.weights[row, there], waiting.means[row, there][None], waiting.sds[row, there][None])
    interval = float(waiting.lower[row]), float(waiting.upper[row])
    known = worth(y, float(mixture.mean()[0]), crps(mixture, 0, y), interval, persistence, yesterday)
    return *known, abs(y - persistence), abs(y - yesterday)


def _back(before: Array, steps: int) -> float:
    """The output `steps` steps ago; NaN where it is not known."""
    return float(before[len(before) - steps]) if steps <= len(before) else float("nan")
