"""What the mathematics is written in: types of array, arrays by name, and lengths of time."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

HOUR, DAY = 3600, 86_400
"""s."""


def together(parts: Mapping[str, Mapping[str, Any]]) -> dict[str, Array]:
    """The arrays of all `parts`, each with the name of its part before its own."""
    return {part + name: np.asarray(value) for part, arrays in parts.items() for name, value in arrays.items()}


def under(part: str, arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The arrays of one `part`, by their own names."""
    return {name.removeprefix(part): value for name, value in arrays.items() if name.startswith(part)}
