"""A table of numbers that grows row by row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.arrays import Array


class Rows:
    """Rows of numbers under `names`."""

    def __init__(self, names: Sequence[str], array: Array | None = None) -> None:
        """Begin with the rows of `array` (K, len(names)), or with none."""
        self.names = tuple(names)
        self._rows: list[list[float]] = [] if array is None else array.tolist()

    def add(self, row: Sequence[float]) -> None:
        """One row more: a number for every name."""
        if len(row) != len(self.names):
            raise ValueError(f"a row of {len(row)} numbers does not fit {len(self.names)} names")
        self._rows.append(list(map(float, row)))

    def __len__(self) -> int:
        return len(self._rows)

    def array(self) -> Array:
        """All rows, (K, len(names))."""
        return np.array(self._rows, dtype=np.float64).reshape(len(self._rows), len(self.names))

    def columns(self) -> dict[str, Array]:
        """Every column (K,) by its name."""
        return dict(zip(self.names, self.array().T, strict=True))
