"""The elementary functions of the kernels against those of NumPy and SciPy."""

import numpy as np
import pytest
from numba import njit
from scipy.special import expit, ndtr

from estimator.kernels.elementary import exponential, logarithm, sigmoid, turned, upper_tail

RNG = np.random.default_rng(0)
ALL_SIZES = np.concatenate([np.linspace(-700.0, 700.0, 20_001), RNG.normal(size=20_000), [0.0, -0.0, 1e-300]])


def over(function, values):
    @njit
    def loop(given, out):
        for w in range(given.shape[0]):
            out[w] = function(given[w])

    out = np.empty(len(values))
    loop(values, out)
    return out


@njit
def cosine(word):
    return turned(word)[0]


@njit
def sine(word):
    return turned(word)[1]


@njit
def tail(z):
    return upper_tail(z, exponential(-0.5 * z * z))


@pytest.mark.parametrize(
    ("function", "values", "expected", "rtol"),
    [
        (exponential, ALL_SIZES, np.exp(ALL_SIZES), 1e-15),
        (logarithm, np.exp(ALL_SIZES), np.log(np.exp(ALL_SIZES)), 1e-15),
        (sigmoid, ALL_SIZES, expit(ALL_SIZES), 1e-15),
        (tail, np.linspace(-8.0, 37.0, 20_001), ndtr(-np.linspace(-8.0, 37.0, 20_001)), 1e-11),
    ],
)
def test_relative_errors_are_roundings(function, values, expected, rtol):
    np.testing.assert_allclose(over(function, values), expected, rtol=rtol, atol=1e-16 if function is logarithm else 0)


def test_a_turn_has_its_cosine_and_sine():
    words = np.concatenate([RNG.integers(0, 2**32, 20_000), np.arange(5) * 2**30 - (np.arange(5) == 4)]).astype(
        np.uint64
    )
    angle = words * (2 * np.pi / 2**32)
    np.testing.assert_allclose(over(cosine, words), np.cos(angle), atol=2e-15)
    np.testing.assert_allclose(over(sine, words), np.sin(angle), atol=2e-15)


def test_exponentials_saturate():
    np.testing.assert_allclose(over(exponential, np.array([-1e9, -708.0])), np.exp(-708.0), rtol=1e-15)
    assert np.isfinite(over(exponential, np.array([709.0, 1e9]))).all()
