"""Between arrays over all particles and the memory of a block.

Places are unsigned. Of a signed one that comes from elsewhere LLVM does not know that it is not negative, in which case
it would count from the end, and gathers particle by particle what lies side by side.
"""

import numpy as np
from numba import njit

from estimator.kernels.jit import PART


@njit(**PART)
def load(rows, first, width, out):  # type: ignore[no-untyped-def]
    """`out` (R, WIDTH) becomes `rows` (R, N) of the particles from `first` on, `width` of them."""
    begin = np.uint64(first)
    for r in range(rows.shape[0]):
        for w in range(np.uint64(width)):
            out[r, w] = rows[r, begin + w]


@njit(**PART)
def store(block, first, width, out):  # type: ignore[no-untyped-def]
    """The particles from `first` on of `out` (R, N) become `block` (R, WIDTH)."""
    begin = np.uint64(first)
    for r in range(out.shape[0]):
        for w in range(np.uint64(width)):
            out[r, begin + w] = block[r, w]


@njit(**PART)
def fixed_parameters(fixed, out):  # type: ignore[no-untyped-def]
    """`out` (n_theta, WIDTH) becomes theta as far as `fixed` (n_theta,) has it."""
    for p in range(fixed.shape[0]):
        for w in range(out.shape[1]):
            out[p, w] = fixed[p]
