"""Elementary functions of one number that LLVM can turn into vector instructions by itself: polynomials, no calls.

The polynomials are those of `estimator.kernels.elementary`. A call of the C library in a loop keeps the loop from
becoming vector code, and Numba's own remedy, Intel's SVML, needs an llvmlite that PyPI does not have.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from estimator.kernels import elementary
from estimator.kernels.lanes import JIT

E = elementary._EXPONENTIAL
_MILLS = elementary._MILLS
_STRETCH = float(elementary._MILLS_STRETCH)
_END = float(elementary._MILLS_END)
_SCALE, _SHIFT = 2.0 / (1.0 - _END), (1.0 + _END) / (1.0 - _END)
_LOG2E, _LN2_HIGH, _LN2_LOW, _ROUND = elementary._LOG2E, elementary._LN2_HIGH, elementary._LN2_LOW, elementary._ROUND
_PER_HALF_LN2 = float(1.0 / elementary._HALF_LN2)
_ONE_OVER_ROOT_TWO = 4604544271217802189
"""The bits of 2^(-1/2)."""
_ATANH = tuple(1.0 / odd for odd in range(21, 0, -2))

_LOG32 = tuple(
    np.float32(coefficient)
    for coefficient in (
        7.0376836292e-2, -1.1514610310e-1, 1.1676998740e-1, -1.2420140846e-1, 1.4249322787e-1, -1.6668057665e-1,
        2.0000714765e-1, -2.4999993993e-1, 3.3333331174e-1,
    )
)  # fmt: skip
_SINE32 = tuple(map(np.float32, (-1.9515295891e-4, 8.3321608736e-3, -1.6666654611e-1)))
_COSINE32 = tuple(map(np.float32, (2.443315711809948e-5, -1.388731625493765e-3, 4.166664568298827e-2)))
_LN2_32, _ONE32, _HALF32, _TURN32 = map(np.float32, (0.6931471805599453, 1.0, 0.5, 2.0 * np.pi / 2.0**32))


@njit(forceinline=True, **JIT)
def exponential(x):  # type: ignore[no-untyped-def]
    """exp(x), saturating at the ends of the range of normal numbers."""
    clipped = x if x > -708.0 else -708.0
    clipped = clipped if clipped < 709.0 else 709.0
    shifted = clipped * _LOG2E + _ROUND
    power = shifted - _ROUND
    r = ((clipped - power * _LN2_HIGH) - power * _LN2_LOW) * _PER_HALF_LN2
    value = E[0] * r + E[1]
    value = (((value * r + E[2]) * r + E[3]) * r + E[4]) * r + E[5]
    value = (((((value * r + E[6]) * r + E[7]) * r + E[8]) * r) + E[9]) * r + E[10]
    exponent = np.float64(shifted).view(np.int64) << 52
    return np.int64(np.float64(value).view(np.int64) + exponent).view(np.float64)


@njit(forceinline=True, **JIT)
def logarithm(x):  # type: ignore[no-untyped-def]
    """log(x) of a positive normal number."""
    word = np.float64(x).view(np.int64)
    exponent = (word - _ONE_OVER_ROOT_TWO) >> 52
    mantissa = np.int64(word - (exponent << 52)).view(np.float64)
    whole = np.float64(np.int32(exponent))
    f = (mantissa - 1.0) / (mantissa + 1.0)
    f2 = f * f
    series = _ATANH[0] * f2 + _ATANH[1]
    series = ((series * f2 + _ATANH[2]) * f2 + _ATANH[3]) * f2 + _ATANH[4]
    series = ((series * f2 + _ATANH[5]) * f2 + _ATANH[6]) * f2 + _ATANH[7]
    series = ((series * f2 + _ATANH[8]) * f2 + _ATANH[9]) * f2 + _ATANH[10]
    return whole * _LN2_HIGH + (whole * _LN2_LOW + f * 2.0 * series)


@njit(forceinline=True, **JIT)
def sigmoid(x):  # type: ignore[no-untyped-def]
    """1 / (1 + exp(-x))."""
    return 1.0 / (exponential(-x) + 1.0)


@njit(forceinline=True, **JIT)
def tail(z, bell):  # type: ignore[no-untyped-def]
    """Q(z), the upper tail of the normal distribution, with bell = exp(-z^2 / 2)."""
    u = 1.0 / (abs(z) * _STRETCH + 1.0)
    p = u * _SCALE - _SHIFT
    value = _MILLS[0] * p + _MILLS[1]
    value = (((value * p + _MILLS[2]) * p + _MILLS[3]) * p + _MILLS[4]) * p + _MILLS[5]
    value = (((value * p + _MILLS[6]) * p + _MILLS[7]) * p + _MILLS[8]) * p + _MILLS[9]
    value = (((value * p + _MILLS[10]) * p + _MILLS[11]) * p + _MILLS[12]) * p + _MILLS[13]
    value = (value * p + _MILLS[14]) * p + _MILLS[15]
    mass = bell * (value * u)
    return 1.0 - mass if z < 0.0 else mass


@njit(forceinline=True, **JIT)
def single_precision_logarithm(x):  # type: ignore[no-untyped-def]
    """log(x) of a positive normal float32."""
    bits = np.float32(x).view(np.int32)
    exponent = np.int32(np.int32(bits - 0x3F3504F3) >> 23)
    mantissa = np.int32(bits - np.int32(exponent << 23)).view(np.float32)
    whole = np.float32(exponent)
    f = mantissa - _ONE32
    series = _LOG32[0] * f + _LOG32[1]
    series = (((series * f + _LOG32[2]) * f + _LOG32[3]) * f + _LOG32[4]) * f + _LOG32[5]
    series = ((series * f + _LOG32[6]) * f + _LOG32[7]) * f + _LOG32[8]
    square = f * f
    return whole * _LN2_32 + (f + (square * f * series - square * _HALF32))


@njit(forceinline=True, **JIT)
def single_precision_turn(turn):  # type: ignore[no-untyped-def]
    """Cosine and sine, float32, of `turn` / 2^32 turns (int32)."""
    quarter = np.int32(np.int32(turn + (1 << 29)) >> 30)
    r = np.float32(np.int32(turn - np.int32(quarter << 30))) * _TURN32
    r2 = r * r
    sine = r + r * r2 * ((_SINE32[0] * r2 + _SINE32[1]) * r2 + _SINE32[2])
    cosine = r2 * r2 * ((_COSINE32[0] * r2 + _COSINE32[1]) * r2 + _COSINE32[2]) + (_ONE32 - r2 * _HALF32)
    swapped = (quarter & 1) != 0
    along = sine if swapped else cosine
    across = cosine if swapped else sine
    along_sign, across_sign = np.int32(((quarter + 1) & 2) << 30), np.int32((quarter & 2) << 30)
    return (
        np.int32(np.float32(along).view(np.int32) ^ along_sign).view(np.float32),
        np.int32(np.float32(across).view(np.int32) ^ across_sign).view(np.float32),
    )
