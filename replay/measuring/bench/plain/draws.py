"""The draws of `estimator.kernels.draws`, one particle at a time: same Philox counters, same bits of every word."""

from __future__ import annotations

import numpy as np
from numba import njit

from estimator.kernels.lanes import JIT
from replay.measuring.bench.plain.elementary import single_precision_logarithm, single_precision_turn

_FIRST, _SECOND = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL_FIRST, _WEYL_SECOND = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW, _SHIFT, _EIGHT = np.uint64(0xFFFFFFFF), np.uint64(32), np.uint64(8)
_ROUNDS = 10
_HALF32, _SCALE32, _MINUS_TWO32 = np.float32(0.5), np.float32(2.0**-31), np.float32(-2.0)


@njit(forceinline=True, **JIT)
def words(seed, step, purpose, row, particle):  # type: ignore[no-untyped-def]
    """Four words (uint32) of the rows `row` to `row` + 3 of one particle."""
    a, b = np.uint64(particle), np.uint64(purpose) | (np.uint64(row) << _EIGHT)
    c, d = step & _LOW, step >> _SHIFT
    key, other = seed & _LOW, seed >> _SHIFT
    for _ in range(_ROUNDS):
        p, q = (a & _LOW) * _FIRST, (c & _LOW) * _SECOND
        a, b, c, d = (q >> _SHIFT) ^ b ^ key, q, (p >> _SHIFT) ^ d ^ other, p
        key, other = key + _WEYL_FIRST, other + _WEYL_SECOND
    return np.uint32(a), np.uint32(b), np.uint32(c), np.uint32(d)


@njit(forceinline=True, **JIT)
def normal_pair(radius, angle):  # type: ignore[no-untyped-def]
    """Two standard normals, float32, from two words (uint32), after Box and Muller."""
    u = (np.float32(np.int32(np.uint32(radius >> 1))) + _HALF32) * _SCALE32
    length = np.sqrt(single_precision_logarithm(u) * _MINUS_TWO32)
    cosine, sine = single_precision_turn(np.int32(angle))
    return length * cosine, length * sine


@njit(forceinline=True, **JIT)
def uniform(word):  # type: ignore[no-untyped-def]
    """A uniform in (0, 1) from a word."""
    return (np.float64(word) + 0.5) * 2.0**-32
