"""What this machine can do at most, measured: multiply-adds in float64 on one core, and bytes from memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numba import njit

from replay.lab.measuring.bench.workload import timed

_LANES = 128
"""Independent sums: enough to fill the pipelines of a core, few enough to stay in its registers."""
_ROUNDS = 400_000
_BYTES = 1 << 28


@njit(fastmath={"contract"}, error_model="numpy", nogil=True)
def _multiply_add(rounds, scale, shift):  # type: ignore[no-untyped-def]
    """`rounds` multiply-adds on each of 128 numbers that do not depend on each other."""
    a = np.ones(_LANES)
    for _ in range(rounds):
        for w in range(_LANES):
            a[w] = a[w] * scale + shift
    return a.sum()


@njit(error_model="numpy", nogil=True)
def _triad(a, b, c, scale):  # type: ignore[no-untyped-def]
    """Two streams in, one out."""
    for i in range(a.shape[0]):
        a[i] = b[i] + scale * c[i]


def peak(repeats: int = 5) -> Mapping[str, Any]:
    """The best of `repeats` runs: flops (a multiply-add is two) and bytes moved per second, of one thread."""
    _multiply_add(10, 0.5, 0.5)
    best = min(timed(lambda: _multiply_add(_ROUNDS, 0.999, 0.001))[0] for _ in range(repeats))
    size = _BYTES // 8
    a, b, c = np.zeros(size), np.ones(size), np.ones(size)
    _triad(a[:8], b[:8], c[:8], 0.5)
    moved = min(timed(lambda: _triad(a, b, c, 0.5))[0] for _ in range(repeats))
    return {
        "flops_per_s": 2.0 * _ROUNDS * _LANES / best,
        # The stream that is written is read first.
        "bytes_per_s": 4.0 * _BYTES / moved,
    }
