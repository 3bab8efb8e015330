"""Elementary functions over lanes: polynomials and bit patterns, eight at a time.

Library functions are called once per number; these are a few multiplications and additions for eight. Relative errors
are a few roundings, as tests hold.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import cheb2poly
from scipy.special import erfcx, iv

from estimator.kernels.lanes import DOUBLES, FLOATS, INTS, WORDS, Value, repeated, unary

_LOG2E = 1.4426950408889634
_LN2_HIGH = 0.6931471803691238
_LN2_LOW = 1.9082149292705877e-10
_ROUND = 6755399441055744.0
"""1.5 * 2^52: adding it rounds to the nearest integer, which then stands in the low bits."""

_HALF_LN2 = np.log(2.0) / 2.0


def _powers(chebyshev: Sequence[float]) -> tuple[float, ...]:
    """Coefficients of powers, highest first, of a series of Chebyshev polynomials."""
    return tuple(float(coefficient) for coefficient in cheb2poly(chebyshev)[::-1])


_EXPONENTIAL = (*_powers([iv(0, _HALF_LN2), *(2.0 * iv(k, _HALF_LN2) for k in range(1, 11))])[:-1], 1.0)
"""exp(r) for |r| <= ln 2 / 2 in r / (ln 2 / 2): a Chebyshev series, relative error 2e-16; exp(0) is 1."""

_MILLS_STRETCH = 0.3 / np.sqrt(2.0)
_MILLS_END = 1.0 / (1.0 + 40.0 * _MILLS_STRETCH)


def _mills(place: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    u = 0.5 * ((1.0 - _MILLS_END) * place + 1.0 + _MILLS_END)
    return np.asarray(erfcx((1.0 / u - 1.0) / (_MILLS_STRETCH * np.sqrt(2.0))) / (2.0 * u))


_MILLS = _powers(Chebyshev.interpolate(_mills, 15).coef.tolist())
"""Q(z) exp(z^2 / 2) / u, the tail of the normal distribution, for 0 <= z <= 40: relative error 1e-12.

A polynomial in u = 1 / (1 + .3 z / sqrt 2), stretched from [_MILLS_END, 1] to [-1, 1].
"""


def polynomial(x: Value, *coefficients: float) -> Value:
    """Horner's rule, highest power first."""
    value = x * coefficients[0] + coefficients[1]
    for coefficient in coefficients[2:]:
        value = value * x + coefficient
    return value


def exponential_of(x: Value) -> Value:
    """exp(x), saturating at the ends of the range of normal numbers."""
    builder = x.builder
    clipped = x.maximum(-708.0).minimum(709.0)
    shifted = clipped * _LOG2E + _ROUND
    power = shifted - _ROUND
    rest = (clipped - power * _LN2_HIGH) - power * _LN2_LOW
    value = polynomial(rest * (1.0 / _HALF_LN2), *_EXPONENTIAL)
    exponent = builder.shl(builder.bitcast(shifted.value, WORDS), repeated(WORDS, 52))
    return x.of(builder.bitcast(builder.add(builder.bitcast(value.value, WORDS), exponent), DOUBLES))


def logarithm_of(x: Value) -> Value:
    """log(x) of positive normal numbers."""
    builder = x.builder
    word = builder.bitcast(x.value, WORDS)
    # The exponent such that the mantissa lies in [2^(-1/2), 2^(1/2)).
    exponent = builder.ashr(builder.sub(word, repeated(WORDS, 4604544271217802189)), repeated(WORDS, 52))
    mantissa = x.of(builder.bitcast(builder.sub(word, builder.shl(exponent, repeated(WORDS, 52))), DOUBLES))
    whole = x.of(builder.sitofp(builder.trunc(exponent, INTS), DOUBLES))
    f = (mantissa - 1.0) / (mantissa + 1.0)
    # log m = 2 atanh f, |f| <= .172.
    series = polynomial(f * f, *(1.0 / odd for odd in range(21, 0, -2)))
    return whole * _LN2_HIGH + (whole * _LN2_LOW + f * 2.0 * series)


def sigmoid_of(x: Value) -> Value:
    """1 / (1 + exp(-x))."""
    return 1.0 / (exponential_of(-x) + 1.0)


def bell_of(z: Value) -> Value:
    """exp(-z^2 / 2)."""
    return exponential_of(z * z * -0.5)


def tail_of(z: Value, bell: Value) -> Value:
    """Q(z), the upper tail of the normal distribution, with bell = exp(-z^2 / 2)."""
    u = 1.0 / (abs(z) * _MILLS_STRETCH + 1.0)
    stretched = u * (2.0 / (1.0 - _MILLS_END)) - (1.0 + _MILLS_END) / (1.0 - _MILLS_END)
    tail = bell * (polynomial(stretched, *_MILLS) * u)
    return (1.0 - tail).chosen(z.below(0.0), tail)


def single_precision_logarithm(x: Value) -> Value:
    """log(x) of positive normal float32 numbers, after Cephes (Moshier 1992)."""
    builder = x.builder
    bits = builder.bitcast(x.value, INTS)
    exponent = builder.ashr(builder.sub(bits, repeated(INTS, 0x3F3504F3)), repeated(INTS, 23))
    mantissa = x.of(builder.bitcast(builder.sub(bits, builder.shl(exponent, repeated(INTS, 23))), FLOATS))
    whole = x.of(builder.sitofp(exponent, FLOATS))
    f = mantissa - 1.0
    series = polynomial(
        f, 7.0376836292e-2, -1.1514610310e-1, 1.1676998740e-1, -1.2420140846e-1, 1.4249322787e-1, -1.6668057665e-1,
        2.0000714765e-1, -2.4999993993e-1, 3.3333331174e-1,
    )  # fmt: skip
    square = f * f
    return whole * 0.6931471805599453 + (f + (square * f * series - square * 0.5))


def single_precision_turn(word: Value, turn: ir.Value) -> tuple[Value, Value]:
    """Cosine and sine, float32, of `turn` / 2^32 turns (32-bit integers), after Cephes; `word` names the code."""
    builder = word.builder
    quarter = builder.ashr(builder.add(turn, repeated(INTS, 1 << 29)), repeated(INTS, 30))
    rest = builder.sub(turn, builder.shl(quarter, repeated(INTS, 30)))
    r = word.of(builder.sitofp(rest, FLOATS)) * (2.0 * np.pi / 2.0**32)
    r2 = r * r
    sine = r + r * r2 * polynomial(r2, -1.9515295891e-4, 8.3321608736e-3, -1.6666654611e-1)
    cosine = r2 * r2 * polynomial(r2, 2.443315711809948e-5, -1.388731625493765e-3, 4.166664568298827e-2) + (
        r2 * -0.5 + 1.0
    )
    swapped = builder.icmp_signed("!=", builder.and_(quarter, repeated(INTS, 1)), repeated(INTS, 0))

    def signed(value: Value, quarters: ir.Value) -> Value:
        sign = builder.shl(builder.and_(quarters, repeated(INTS, 2)), repeated(INTS, 30))
        return value.of(builder.bitcast(builder.xor(builder.bitcast(value.value, INTS), sign), FLOATS))

    along, across = sine.chosen(swapped, cosine), cosine.chosen(swapped, sine)
    return signed(along, builder.add(quarter, repeated(INTS, 1))), signed(across, quarter)


exponential = unary(exponential_of)
logarithm = unary(logarithm_of)
sigmoid = unary(sigmoid_of)
bell = unary(bell_of)
