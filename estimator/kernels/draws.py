"""Random numbers by position, not by history.

A zone's draws at step k come from the counter-based generator Philox4x32-10 (Salmon et al. 2011), keyed by the zone's
seed, with the step, the purpose and the index of the draw as counter. The whole state of the generator is therefore
(seed, step), which the checkpoint carries anyway: predicting twice, or after a restart, gives the same bits, and so
does any division of the work.

Draws have shape (rows, N): one counter gives particle n its draws of four rows. Normal deviates come from pairs of
words by Box and Muller.
"""

from enum import IntEnum
from math import sqrt

import numpy as np
from numba import njit

from estimator.arrays import Array
from estimator.kernels.elementary import logarithm, turned
from estimator.kernels.jit import INLINE, JIT

_MULTIPLIERS = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW, _HALF, _BYTE, _ONE = np.uint64(0xFFFFFFFF), np.uint64(32), np.uint64(8), np.uint64(1)
_ROUNDS = 10

ROWS = 4
"""Rows of draws that one counter gives."""


class Purpose(IntEnum):
    """What draws are for; every purpose of every step has its own stream."""

    PRIOR_PARAMETERS = 0
    PRIOR_VOLATILITY = 1
    WALK = 2
    RESAMPLE = 5
    REJUVENATE = 6
    PRIOR_NOISE = 17
    PRIOR_GAIN = 18
    MIXTURE_WALK = 19
    MIXTURE_SWITCH = 20
    MIXTURE_SAMPLE = 21
    SCENARIO = 22
    SCENARIO_SWITCH = 23
    LAW = 24
    FORESEEN = 33
    FORECAST = 8
    """Added to the purpose of a draw that belongs to a forecast, so that asking for one changes nothing."""


@njit(**JIT | {"forceinline": True})
def words(seed, step, purpose, row, particle):  # type: ignore[no-untyped-def]
    """Four 32-bit words: the rows `row` to `row` + 3 of one particle; `seed` and `step` are uint64."""
    a, b = np.uint64(particle), np.uint64(purpose) | (np.uint64(row) << _BYTE)
    c, d = step & _LOW, step >> _HALF
    key, other = seed & _LOW, seed >> _HALF
    for _ in range(_ROUNDS):
        # What the high halves hold does not matter: only low halves are multiplied.
        p, q = (a & _LOW) * _MULTIPLIERS[0], (c & _LOW) * _MULTIPLIERS[1]
        a, b, c, d = (q >> _HALF) ^ b ^ key, q, (p >> _HALF) ^ d ^ other, p
        key, other = key + _WEYL[0], other + _WEYL[1]
    return a & _LOW, b & _LOW, c & _LOW, d & _LOW


@njit(**INLINE)
def normal_pair(radius, angle):  # type: ignore[no-untyped-def]
    """Two standard normals from two words."""
    length = sqrt(-2.0 * logarithm((np.float64(radius >> _ONE) + 0.5) * 2.0**-31))
    cosine, sine = turned(angle)
    return length * cosine, length * sine


@njit(**INLINE)
def uniform(word):  # type: ignore[no-untyped-def]
    """A uniform in (0, 1) from a word."""
    return (np.float64(word) + 0.5) * 2.0**-32


@njit(**JIT)
def padded(rows):  # type: ignore[no-untyped-def]
    """Rows of memory that `fill` takes for `rows` rows: as many as whole counters give."""
    return (rows + ROWS - 1) // ROWS * ROWS


@njit(**JIT)
def fill(seed, step, purpose, normal, first, width, out):  # type: ignore[no-untyped-def]
    """`out` (`padded` rows, at least `width`): draws of the particles from `first` on, standard normals or uniforms."""
    for row in range(0, out.shape[0], ROWS):
        if normal:
            for w in range(width):
                a, b, c, d = words(seed, step, purpose, row, first + w)
                out[row, w], out[row + 1, w] = normal_pair(a, b)
                out[row + 2, w], out[row + 3, w] = normal_pair(c, d)
        else:
            for w in range(width):
                a, b, c, d = words(seed, step, purpose, row, first + w)
                out[row, w], out[row + 1, w] = uniform(a), uniform(b)
                out[row + 2, w], out[row + 3, w] = uniform(c), uniform(d)


class Draws:
    """The draws of one zone at one step; `forecast` selects the streams of a forecast from there."""

    def __init__(self, seed: int, step: int, *, forecast: bool = False) -> None:
        self.seed, self.step = np.uint64(seed), np.uint64(step)
        self._offset = Purpose.FORECAST if forecast else 0

    def stream(self, purpose: Purpose) -> int:
        """The number of a purpose's stream, for a kernel that draws for itself."""
        return int(purpose + self._offset)

    def normals(self, purpose: Purpose, shape: tuple[int, int]) -> Array:
        """Standard normals (rows, N)."""
        return self._filled(purpose, shape, normal=True)

    def uniforms(self, purpose: Purpose, shape: tuple[int, int]) -> Array:
        """Uniforms (rows, N) in (0, 1)."""
        return self._filled(purpose, shape, normal=False)

    def _filled(self, purpose: Purpose, shape: tuple[int, int], *, normal: bool) -> Array:
        rows, count = shape
        out = np.empty((padded(rows), count))
        fill(self.seed, self.step, self.stream(purpose), normal, 0, count, out)
        return out[:rows]
