"""How a room answers its inputs from hour to hour, by least squares: late meters, and heat that nobody tells of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array

_RIDGE = 1e-3
_LAST = 24
"""h over which a meter is judged."""

_WORSE, _BETTER = 1.5, 0.5
"""The last day must be worse explained than the reference by this factor, and late heat must explain it this much
better: on heated buildings without faults one hour in a hundred comes near."""


_EXPLAINED = 0.15
"""K/h: an error up to this is usual in any room. A changed set-point brings less than .1, a drift that matters more."""


class Response(NamedTuple):
    """How the room answered its inputs in the reference, and what of its rise is not explained by that."""

    hours: Array
    """(h, n): the telemetry of whole hours, the room in column 0."""
    kinds: Sequence[str]
    """What each column is."""
    coefficients: Array
    """(p,): of the regressors."""
    errors: Array
    """(h - 3,): of the rise [K] from an hour to the next; NaN where something was not measured."""
    known: int
    """How many of them belong to the reference."""


def response(past: Array, new: Array, kinds: Sequence[str], slots: int) -> Response | None:
    """The response of the room in the reference `past` (m, n), and its errors from there to the end of `new` (k, n);
    rows come `slots` an hour. None where the reference is too short."""
    hours = _hourly(np.concatenate([past, new]), slots)
    known = len(past) // slots - 3
    if known < 3 * _LAST - 3 or len(hours) - known < 5:
        return None
    regressors, rise = _regression(hours, kinds, 0, 0)
    good = np.isfinite(regressors).all(axis=1) & np.isfinite(rise)
    reference = good & (np.arange(len(rise)) < known)
    if reference.sum() < 2 * _LAST:
        return None
    scale = np.maximum(regressors[reference].std(axis=0), 1e-9)
    scale[0] = 1.0
    known_rows = regressors[reference] / scale
    gram = known_rows.T @ known_rows + _RIDGE * len(known_rows) * np.eye(len(scale))
    coefficients = np.linalg.solve(gram, known_rows.T @ rise[reference]) / scale
    return Response(hours, kinds, coefficients, np.where(good, rise - regressors @ coefficients, np.nan), known)


def lateness(found: Response, column: int) -> bool:
    """Whether the room's last day follows what the meter in `column` tells an hour later."""
    usual = float(np.nanvar(found.errors[: found.known]))
    ahead, rise = _regression(found.hours, found.kinds, column, 1)
    last = np.flatnonzero(np.isfinite(found.errors))[-_LAST - 1 : -1]
    last = last[last >= len(rise) - _LAST - 1]
    if len(last) < _LAST // 2:
        return False
    now, shifted = np.mean(found.errors[last] ** 2), np.mean((rise - ahead @ found.coefficients)[last] ** 2)
    return bool(now > _WORSE * usual and shifted < _BETTER * now)


def unexplained(found: Response, hours: int) -> Array:
    """(w,): the mean error of each `hours` in a row since the reference, over the largest of such means in the
    reference, _EXPLAINED at least; NaN where something was not measured. The last one is that of the last hours."""
    means = np.convolve(found.errors, np.full(hours, 1.0 / hours), "valid")
    usual = np.nanmax(means[: max(found.known - hours + 1, 1)], initial=_EXPLAINED)
    return np.asarray(means[found.known :] / usual)


def _hourly(rows: Array, slots: int) -> Array:
    """(h, n): means of whole hours that end with the last row; NaN where a slot is missing."""
    count = len(rows) // slots
    return np.asarray(rows[len(rows) - count * slots :].reshape(count, slots, -1).mean(axis=1))


def _regression(hours: Array, kinds: Sequence[str], late: int, by: int) -> tuple[Array, Array]:
    """Regressors (h - 3, p) and rise of the room (h - 3,) [K] from an hour to the next, with the column `late` taken
    `by` hours later."""
    room = hours[:, 0]
    at = np.arange(2, len(hours) - 1)
    columns = [np.ones(len(at)), room[at] - room[at - 1], room[at - 1] - room[at - 2]]
    for column, kind in enumerate(kinds[1:], 1):
        values = hours[:, column]
        if kind == "outside":
            columns.append(values[at] - room[at])
            continue
        if column == late and by:
            values = np.concatenate([values[by:], np.full(by, values[-1])])
        columns += [values[at + 1], values[at], values[at - 1]]
    return np.column_stack(columns), room[at + 1] - room[at]
