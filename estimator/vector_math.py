"""Elementary functions over arrays, in forms that the compiler turns into vector instructions.

Library functions are called once per element; these are multiplications and additions on eight elements at a time.
Sums may be reordered into vector lanes, in an order that is fixed when they are compiled: the same inputs give the
same bits. For that a sum runs in a local variable: one that is stored in an array as it grows would be vectorised only
where the compiler finds at run time that the arrays lie far enough apart, and its bits would depend on addresses.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from estimator.unrolled import JIT

SUMMING: Any = JIT | {"fastmath": {"contract", "reassoc", "nsz"}}

_LOG2E = 1.4426950408889634
_LN2_HIGH = 0.6931471803691238
_LN2_LOW = 1.9082149292705877e-10
_ROUND = 6755399441055744.0
"""1.5 * 2^52: adding and subtracting it rounds to the nearest integer."""

_MILLS_STRETCH = 0.3 / np.sqrt(2.0)
_MILLS_END = 0.1053740779768177
_MILLS = np.array(
    [7.472068446235936e-10, -2.1205097705197897e-09, -8.609975160015604e-09, 2.8531087453770688e-08,
     7.253387575915887e-08, -2.637882863979437e-07, -7.04087431322517e-07, 2.130815666005215e-06,
     8.64631981277426e-06, -1.129526279258023e-05, -0.00011549414182380861, -0.00014331607302668937,
     0.001041473609890521, 0.0066132543311078155, 0.021915251055889325, 0.05194498105118817, 0.09618364429191864,
     0.1443257302356338, 0.17823587056056808]
)  # fmt: skip
"""Polynomial for Q(z) exp(z^2 / 2), the tail of the normal distribution: relative error 2e-14 for 0 <= z <= 40.

A Chebyshev interpolant of erfcx(z / sqrt 2) / (2 u) in u = 1 / (1 + .3 z / sqrt 2), stretched from [_MILLS_END, 1] to
[-1, 1], highest power first.
"""

BLOCK = 512


@njit(cache=True, **JIT)
def exponentials(x, bits, count):  # type: ignore[no-untyped-def]
    """x[:count] <- exp(x[:count]), saturating at the ends of the range; `bits` is integer scratch as long as x."""
    power = bits.view(np.float64)
    for t in range(count):
        clipped = min(max(x[t], -708.0), 709.0)
        k = (clipped * _LOG2E + _ROUND) - _ROUND
        bits[t] = (int(k) + 1023) << 52
        r = (clipped - k * _LN2_HIGH) - k * _LN2_LOW
        # Taylor to degree 13 on |r| <= ln 2 / 2.
        p = 1.0 / 6227020800.0
        p = p * r + 1.0 / 479001600.0
        p = p * r + 1.0 / 39916800.0
        p = p * r + 1.0 / 3628800.0
        p = p * r + 1.0 / 362880.0
        p = p * r + 1.0 / 40320.0
        p = p * r + 1.0 / 5040.0
        p = p * r + 1.0 / 720.0
        p = p * r + 1.0 / 120.0
        p = p * r + 1.0 / 24.0
        p = p * r + 1.0 / 6.0
        p = p * r + 0.5
        p = p * r + 1.0
        x[t] = p * r + 1.0
    for t in range(count):
        x[t] *= power[t]


@njit(cache=True, **JIT)
def logarithms(x, bits, count):  # type: ignore[no-untyped-def]
    """x[:count] <- log(x[:count]) for positive normal numbers; `bits` is integer scratch as long as x."""
    mantissa = bits.view(np.float64)
    for t in range(count):
        mantissa[t] = x[t]
    for t in range(count):
        word = bits[t]
        # The exponent such that the mantissa lies in [2^(-1/2), 2^(1/2)).
        exponent = (word - 4604544271217802189) >> 52
        bits[t] = word - (exponent << 52)
        x[t] = exponent
    for t in range(count):
        f = (mantissa[t] - 1.0) / (mantissa[t] + 1.0)
        f2 = f * f
        # log m = 2 atanh f, |f| <= .172.
        p = 1.0 / 21.0
        p = p * f2 + 1.0 / 19.0
        p = p * f2 + 1.0 / 17.0
        p = p * f2 + 1.0 / 15.0
        p = p * f2 + 1.0 / 13.0
        p = p * f2 + 1.0 / 11.0
        p = p * f2 + 1.0 / 9.0
        p = p * f2 + 1.0 / 7.0
        p = p * f2 + 1.0 / 5.0
        p = p * f2 + 1.0 / 3.0
        p = p * f2 + 1.0
        x[t] = x[t] * _LN2_HIGH + (x[t] * _LN2_LOW + 2.0 * f * p)


@njit(cache=True, **SUMMING)
def mixture_cdf(y, weights, means, precisions, z, x, bits):  # type: ignore[no-untyped-def]
    """CDF and density at `y` of a Gaussian mixture; `precisions` are 1 / sd; z, x (BLOCK,) and bits are scratch."""
    cdf = 0.0
    density = 0.0
    for first in range(0, weights.shape[0], BLOCK):
        count = min(BLOCK, weights.shape[0] - first)
        for t in range(count):
            z[t] = (y - means[first + t]) * precisions[first + t]
            x[t] = -0.5 * z[t] * z[t]
        exponentials(x, bits, count)
        for t in range(count):
            u = 1.0 / (1.0 + _MILLS_STRETCH * abs(z[t]))
            k = (2.0 * u - (1.0 + _MILLS_END)) * (1.0 / (1.0 - _MILLS_END))
            p = 0.0
            for i in range(19):
                p = p * k + _MILLS[i]
            tail = x[t] * p * u
            cdf += weights[first + t] * (tail if z[t] < 0.0 else 1.0 - tail)
            density += weights[first + t] * x[t] * precisions[first + t]
    return cdf, density * 0.3989422804014327


@njit(cache=True, **JIT)
def mixture_quantile(level, start, weights, means, sds):  # type: ignore[no-untyped-def]
    """The `level` quantile of a Gaussian mixture, by Newton's method from `start`, kept in a shrinking bracket.

    weights (N,) sum to 1; means and sds (N,) in degC and K.
    """
    particles = weights.shape[0]
    precisions = np.empty(particles)
    lower, upper, narrowest = np.inf, -np.inf, np.inf
    for n in range(particles):
        precisions[n] = 1.0 / sds[n]
    for n in range(particles):
        if weights[n] > 0.0:
            lower = min(lower, means[n] - 9.0 * sds[n])
            upper = max(upper, means[n] + 9.0 * sds[n])
            narrowest = min(narrowest, sds[n])
    z, x, bits = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK, np.int64)
    y = start
    for _ in range(200):
        if not lower < y < upper:
            y = 0.5 * (lower + upper)
        cdf, density = mixture_cdf(y, weights, means, precisions, z, x, bits)
        error = cdf - level
        if error > 0.0:
            upper = y
        else:
            lower = y
        step = error / density if density > 0.0 else np.inf
        tolerance = 1e-13 * max(1.0, abs(y))
        # What a Newton step leaves is at most step^2 f' / (2 f), and f' / f at most 9 over the smallest sd.
        if 4.5 * step * step <= tolerance * narrowest:
            return y - step
        if upper - lower <= tolerance:
            return y
        y -= step
    return y
