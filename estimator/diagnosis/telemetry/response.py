"""How a room answers its inputs from hour to hour, by least squares, and whether a meter is late."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.arrays import Array

_RIDGE = 1e-3
_LAST = 24
"""h over which a meter is judged."""

_WORSE, _BETTER = 1.5, 0.5
"""The last day must be worse explained than the reference by this factor, and late heat must explain it this much
better: on heated buildings without faults one hour in a hundred comes near."""


def lateness(past: Array, new: Array, column: int, kinds: Sequence[str], slots: int) -> bool:
    """Whether the rooms's last day follows what the meter in `column` tells an hour later. `past` (m, n) and `new`
    (k, n) have so many `slots` an hour, the room's temperature in column 0, and what each column is in `kinds`."""
    rows = np.concatenate([past, new])
    hours = _hourly(rows, slots)
    known = len(past) // slots
    if known < 3 * _LAST or len(hours) - known < 2:
        return False
    regressors, rise = _regression(hours, kinds, column, 0)
    ahead, _ = _regression(hours, kinds, column, 1)
    good = np.isfinite(regressors).all(axis=1) & np.isfinite(rise)
    reference = good & (np.arange(len(rise)) < known - 3)
    if reference.sum() < 2 * _LAST:
        return False
    scale = np.maximum(regressors[reference].std(axis=0), 1e-9)
    scale[0] = 1.0
    known_rows = regressors[reference] / scale
    gram = known_rows.T @ known_rows + _RIDGE * len(known_rows) * np.eye(len(scale))
    coefficients = np.linalg.solve(gram, known_rows.T @ rise[reference]) / scale
    errors, usual = (
        rise - regressors @ coefficients,
        float(np.var(rise[reference] - regressors[reference] @ coefficients)),
    )
    last = np.flatnonzero(good)[-_LAST - 1 : -1]
    last = last[last >= len(rise) - _LAST - 1]
    if len(last) < _LAST // 2:
        return False
    now, shifted = np.mean(errors[last] ** 2), np.mean((rise - ahead @ coefficients)[last] ** 2)
    return bool(now > _WORSE * usual and shifted < _BETTER * now)


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
