"""Elementary functions that LLVM can turn into vector instructions: polynomials and bit patterns in place of calls.

Relative errors are a few roundings.
"""

from math import factorial, pi, sqrt

import numpy as np
from numba import njit
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import cheb2poly
from scipy.special import erfcx

from estimator.arrays import Array
from estimator.kernels.jit import INLINE

_LOG2E = 1.4426950408889634
_LN2_HIGH, _LN2_LOW = 0.6931471803691238, 1.9082149292705877e-10
_ROUND = 6755399441055744.0
"""1.5 * 2^52: adding it rounds to the nearest integer, which then stands in the low bits."""
_ROOT_HALF_BITS = 4604544271217802189
"""The bits of 2^(-1/2)."""

_EXPONENTIAL = tuple(1.0 / factorial(k) for k in range(13, -1, -1))
_ATANH = tuple(1.0 / odd for odd in range(21, 0, -2))
_SINE = tuple((-1) ** k / factorial(2 * k + 1) for k in range(7, 0, -1))
_COSINE = tuple((-1) ** k / factorial(2 * k) for k in range(8, 1, -1))

_STRETCH = 0.3 / sqrt(2.0)
_END = 1.0 / (1.0 + 40.0 * _STRETCH)


def _scaled_tail(place: Array) -> Array:
    u = 0.5 * ((1.0 - _END) * place + 1.0 + _END)
    return erfcx((1.0 / u - 1.0) / (_STRETCH * sqrt(2.0))) / (2.0 * u)


_TAIL = [float(c) for c in cheb2poly(Chebyshev.interpolate(_scaled_tail, 15).coef)[::-1]]
_TAIL_HIGH, _TAIL_LOW = tuple(_TAIL[:8]), tuple(_TAIL[8:])
"""Q(z) exp(z^2 / 2) / u for 0 <= z <= 40, where u = 1 / (1 + .3 z / sqrt 2), stretched from [_END, 1] to [-1, 1].

Relative error 1e-12.
"""


@njit(**INLINE)
def exponential(x):  # type: ignore[no-untyped-def]
    """exp(x), saturating at the ends of the range of normal numbers."""
    inside = min(max(x, -708.0), 709.0)
    shifted = inside * _LOG2E + _ROUND
    power = shifted - _ROUND
    rest = (inside - power * _LN2_HIGH) - power * _LN2_LOW
    value = 0.0
    for coefficient in _EXPONENTIAL:
        value = value * rest + coefficient
    exponent = np.float64(shifted).view(np.int64) << 52
    return np.int64(np.float64(value).view(np.int64) + exponent).view(np.float64)


@njit(**INLINE)
def logarithm(x):  # type: ignore[no-untyped-def]
    """log(x) of a positive normal number: 2 atanh f of a mantissa between 2^(-1/2) and 2^(1/2)."""
    word = np.float64(x).view(np.int64)
    exponent = (word - _ROOT_HALF_BITS) >> 52
    mantissa = np.int64(word - (exponent << 52)).view(np.float64)
    whole = np.float64(np.int32(exponent))
    f = (mantissa - 1.0) / (mantissa + 1.0)
    square, series = f * f, 0.0
    for coefficient in _ATANH:
        series = series * square + coefficient
    return whole * _LN2_HIGH + (whole * _LN2_LOW + f * 2.0 * series)


@njit(**INLINE)
def turned(word):  # type: ignore[no-untyped-def]
    """Cosine and sine of `word` / 2^32 turns, 0 <= `word` < 2^32."""
    whole = np.int64(word)
    quarter = (whole + (1 << 29)) >> 30
    r = np.float64(np.int32(whole - (quarter << 30))) * (2.0 * pi / 2.0**32)
    square, odd, even = r * r, 0.0, 0.0
    for coefficient in _SINE:
        odd = odd * square + coefficient
    for coefficient in _COSINE:
        even = even * square + coefficient
    sine, cosine = r + r * square * odd, 1.0 + square * (square * even - 0.5)
    swapped = quarter & 1 != 0
    along, across = sine if swapped else cosine, cosine if swapped else sine
    return -along if (quarter + 1) & 2 != 0 else along, -across if quarter & 2 != 0 else across


@njit(**INLINE)
def sigmoid(x):  # type: ignore[no-untyped-def]
    """1 / (1 + exp(-x))."""
    return 1.0 / (1.0 + exponential(-x))


@njit(**INLINE)
def upper_tail(z, bell):  # type: ignore[no-untyped-def]
    """Q(z), the upper tail of the normal distribution, with `bell` = exp(-z^2 / 2)."""
    u = 1.0 / (1.0 + abs(z) * _STRETCH)
    place, value = u * (2.0 / (1.0 - _END)) - (1.0 + _END) / (1.0 - _END), 0.0
    # LLVM unrolls no longer loop.
    for coefficient in _TAIL_HIGH:
        value = value * place + coefficient
    for coefficient in _TAIL_LOW:
        value = value * place + coefficient
    tail = bell * (value * u)
    return 1.0 - tail if z < 0.0 else tail
