"""Random numbers by position, not by history.

A zone's draws at step k come from the counter-based generator Philox4x32-10 (Salmon et al. 2011), keyed by the zone's
seed, with the step, the purpose and the index of the draw as counter. The whole state of the generator is therefore
(seed, step), which the checkpoint carries anyway: predicting twice, or after a restart, gives the same bits, and so
does any division of the work.
"""

from __future__ import annotations

from enum import IntEnum
from math import prod

import numpy as np
from numba import njit

from estimator.types import Array
from estimator.unrolled import JIT
from estimator.vector_math import BLOCK, logarithms

_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW, _SHIFT = np.uint64(0xFFFFFFFF), np.uint64(32)
_TURN = 2.0 * np.pi / 2.0**32


class Purpose(IntEnum):
    """What draws are for; every purpose of every step has its own stream."""

    PRIOR_PARAMETERS = 0
    PRIOR_VOLATILITY = 1
    WALK = 2
    JUMP = 3
    JUMP_SIZE = 4
    RESAMPLE = 5
    REJUVENATE = 6
    FORECAST = 8
    """Added to the purpose of a draw that belongs to a forecast, so that asking for one changes nothing."""


@njit(cache=True, **JIT)
def philox(seed, step, purpose, first, count, a, b, c, d):  # type: ignore[no-untyped-def]
    """32-bit words a, b, c, d (uint64 arrays) of counters (first + t, purpose, step) for t < count, keyed by `seed`."""
    low_step, high_step = step & _LOW, step >> _SHIFT
    low_key, high_key = seed & _LOW, seed >> _SHIFT
    for t in range(count):
        c0, c1, c2, c3 = np.uint64(first + t) & _LOW, purpose, low_step, high_step
        k0, k1 = low_key, high_key
        for _ in range(10):
            p0, p1 = _M0 * c0, _M1 * c2
            c0, c1, c2, c3 = (p1 >> _SHIFT) ^ c1 ^ k0, p1 & _LOW, (p0 >> _SHIFT) ^ c3 ^ k1, p0 & _LOW
            k0, k1 = (k0 + _W0) & _LOW, (k1 + _W1) & _LOW
        a[t], b[t], c[t], d[t] = c0, c1, c2, c3


@njit(cache=True, **JIT)
def _box_muller(radius_word, angle_word, count, x, bits, cosines, sines):  # type: ignore[no-untyped-def]
    """Two standard normals for every pair of words: sqrt(-2 log u) times cosine and sine of a uniform angle."""
    for t in range(count):
        x[t] = (np.int64(radius_word[t]) + 0.5) * 2.0**-32
    logarithms(x, bits, count)
    for t in range(count):
        word = np.int64(angle_word[t])
        quarter = (word + 536870912) >> 30
        r = (word - (quarter << 30)) * _TURN
        r2 = r * r
        # Taylor on |r| <= pi / 4.
        sine = r * (1.0 + r2 * (-1 / 6 + r2 * (1 / 120 + r2 * (-1 / 5040 + r2 * (1 / 362880 + r2 * (
            -1 / 39916800 + r2 * (1 / 6227020800 - r2 / 1307674368000)))))))  # fmt: skip
        cosine = 1.0 + r2 * (-0.5 + r2 * (1 / 24 + r2 * (-1 / 720 + r2 * (1 / 40320 + r2 * (
            -1 / 3628800 + r2 * (1 / 479001600 - r2 / 87178291200))))))  # fmt: skip
        length = np.sqrt(-2.0 * x[t])
        swap = (quarter & 1) == 1
        along = sine if swap else cosine
        across = cosine if swap else sine
        cosines[t] = length * (-along if ((quarter + 1) & 2) != 0 else along)
        sines[t] = length * (-across if (quarter & 2) != 0 else across)


@njit(cache=True, **JIT)
def _fill_normals(seed, step, purpose, out):  # type: ignore[no-untyped-def]
    words = np.empty((4, BLOCK), np.uint64)
    x, bits = np.empty(BLOCK), np.empty(BLOCK, np.int64)
    normals = np.empty((4, BLOCK))
    size = out.shape[0]
    for first in range(0, (size + 3) // 4, BLOCK):
        philox(seed, step, purpose, first, BLOCK, words[0], words[1], words[2], words[3])
        _box_muller(words[0], words[1], BLOCK, x, bits, normals[0], normals[1])
        _box_muller(words[2], words[3], BLOCK, x, bits, normals[2], normals[3])
        for part in range(4):
            begin = 4 * first + part * BLOCK
            for t in range(min(BLOCK, size - begin)):
                out[begin + t] = normals[part, t]


@njit(cache=True, **JIT)
def _fill_uniforms(seed, step, purpose, out):  # type: ignore[no-untyped-def]
    words = np.empty((4, BLOCK), np.uint64)
    size = out.shape[0]
    for first in range(0, (size + 3) // 4, BLOCK):
        philox(seed, step, purpose, first, BLOCK, words[0], words[1], words[2], words[3])
        for part in range(4):
            begin = 4 * first + part * BLOCK
            for t in range(min(BLOCK, size - begin)):
                out[begin + t] = (np.int64(words[part, t]) + 0.5) * 2.0**-32


class Draws:
    """The draws of one zone at one step; `forecast` selects the streams of a forecast from there."""

    def __init__(self, seed: int, step: int, *, forecast: bool = False) -> None:
        self._seed, self._step = np.uint64(seed), np.uint64(step)
        self._offset = Purpose.FORECAST if forecast else 0

    def normals(self, purpose: Purpose, shape: tuple[int, ...]) -> Array:
        """Standard normals."""
        out = np.empty(prod(shape))
        _fill_normals(self._seed, self._step, np.uint64(purpose + self._offset), out)
        return out.reshape(shape)

    def uniforms(self, purpose: Purpose, shape: tuple[int, ...]) -> Array:
        """Uniforms in (0, 1)."""
        out = np.empty(prod(shape))
        _fill_uniforms(self._seed, self._step, np.uint64(purpose + self._offset), out)
        return out.reshape(shape)
