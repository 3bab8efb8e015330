"""How a room answers its inputs from slot to slot, by least squares, and what speaks for inputs other than those told.

The errors of the fit are taken for Student's t, since windows and visitors leave a tail. If the inputs were others, the
same room would leave other errors: the ratio of the two likelihoods, gathered as in Page's test (CUSUM), is the
evidence for that. The reference says how much evidence comes about when nothing is wrong.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from estimator.arrays import Array

_RIDGE = 1e-3
_LONGEST = 6
"""Slots that the regressors reach back."""
_LAGS = 4
"""Slots of a heat among them."""
_LEAST = 288
"""Slots that must be complete in the reference."""
_FREEDOM = 3.0
"""Of Student's t."""
_FINEST = 0.01
"""K: no thermometer tells a rise more exactly."""


class Response(NamedTuple):
    """How the room answered its inputs in the reference, the first `known` of n slots."""

    rows: Array
    """(n, c): the room in column 0, then the inputs."""
    regressors: Array
    """(n - 7, p): of the rise [K] into each slot from the eighth on."""
    rise: Array
    """(n - 7,)."""
    known: int
    kinds: Sequence[str]
    """What each column is."""
    coefficients: Array
    """(p,): of the regressors."""
    errors: Array
    """(n,): of the rise [K] into each slot; NaN where something was not measured."""
    scale: float
    """Of the errors in the reference [K]."""

    def errors_if(self, column: int, values: Array, begin: int) -> Array:
        """(n - begin,): what the errors would be from slot `begin` on if a heat had been `values` (n,)."""
        place, first = self._place(column), max(begin - _LONGEST - 1, 0)
        regressors = self.regressors[first:].copy()
        regressors[:, place : place + _LAGS] = _lags(values)[first:]
        errors = np.full(len(values) - begin, np.nan)
        errors[len(errors) - len(regressors) :] = self.rise[first:] - regressors @ self.coefficients
        return errors

    def effect(self, column: int) -> float:
        """K by which the first slots of a unit of a heat move the room."""
        place = self._place(column)
        return float(self.coefficients[place : place + 2].sum())

    def _place(self, column: int) -> int:
        """Of the first regressor of a heat."""
        return 5 + _LAGS * [at for at, kind in enumerate(self.kinds) if kind != "outside" and at].index(column)

    def log_likelihood(self, errors: Array) -> Array:
        """(...,): of `errors` (...,), but for a constant."""
        return np.asarray(-(_FREEDOM + 1.0) / 2.0 * np.log1p(errors**2 / (_FREEDOM * self.scale**2)))


def response(rows: Array, known: int, kinds: Sequence[str]) -> Response | None:
    """The response of the room in the first `known` of `rows` (n, c); None where too little of that is complete."""
    regressors, rise = _regression(rows, kinds)
    good = np.isfinite(regressors).all(axis=1) & np.isfinite(rise)
    reference = np.flatnonzero(good[: max(known - _LONGEST - 1, 0)])
    if len(reference) < _LEAST:
        return None
    scale = np.maximum(regressors[reference].std(axis=0), 1e-9)
    scale[0] = 1.0
    past = regressors[reference] / scale
    gram = past.T @ past + _RIDGE * len(past) * np.eye(len(scale))
    coefficients = np.linalg.solve(gram, past.T @ rise[reference]) / scale
    errors = np.full(len(rows), np.nan)
    errors[_LONGEST + 1 :] = rise - regressors @ coefficients
    usual = errors[:known][np.isfinite(errors[:known])]
    low, high = np.quantile(usual, [0.16, 0.84])
    spread = max((high - low) / 2.0, 0.3 * float(usual.std()), _FINEST)
    return Response(rows, regressors, rise, known, kinds, coefficients, errors, spread)


def gathered(ratios: Array, slots: int) -> Array:
    """(n,): the largest sum of the log-likelihood `ratios` (n,) up to each slot that begins within the last `slots`."""
    sums = np.concatenate([np.zeros(slots + 1), np.cumsum(np.where(np.isfinite(ratios), ratios, 0.0))])
    return np.asarray(sums[slots + 1 :] - sliding_window_view(sums[1:], slots + 1).min(axis=1)[: len(ratios)])


def _regression(rows: Array, kinds: Sequence[str]) -> tuple[Array, Array]:
    """Regressors (n - 7, p) and rise of the room (n - 7,) [K] from a slot to the next."""
    room, count = rows[:, 0], len(rows)
    steps, now = np.diff(room), slice(_LONGEST, count - 1)
    columns = [
        np.ones((count - _LONGEST - 1, 1)),
        *(steps[_LONGEST - 1 - k : count - 2 - k, None] for k in range(3)),
        (room[_LONGEST - 3 : count - 4] - room[: count - _LONGEST - 1])[:, None],
        *(_lags(rows[:, column]) for column, kind in enumerate(kinds) if kind != "outside" and column),
        *((rows[now, column] - room[now])[:, None] for column, kind in enumerate(kinds) if kind == "outside"),
    ]
    return np.hstack(columns), steps[now]


def _lags(values: Array) -> Array:
    """(n - 7, _LAGS): of each slot from the eighth on what `values` (n,) are in it and before it."""
    return sliding_window_view(values[_LONGEST + 2 - _LAGS :], _LAGS)[:, ::-1]
