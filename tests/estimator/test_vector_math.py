"""The vectorised elementary functions against NumPy's and SciPy's."""

import numpy as np
import pytest
from scipy.special import ndtr

from estimator.vector_math import BLOCK, exponentials, logarithms, mixture_cdf

ULP = np.finfo(float).eps


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("reach", [0.1, 5.0, 700.0])
def test_exponentials(seed, reach):
    x = np.random.default_rng(seed).uniform(-reach, reach, BLOCK)
    found = x.copy()
    exponentials(found, np.empty(BLOCK, np.int64), BLOCK)
    np.testing.assert_allclose(found, np.exp(x), rtol=4 * ULP)


def test_exponentials_saturate():
    x = np.array([-1e9, -np.inf, 1e9, 0.0, -0.0])
    exponentials(x, np.empty(5, np.int64), 5)
    assert x[0] == x[1] < 1e-300
    assert 1e300 < x[2] < np.inf
    assert (x[3:] == 1.0).all()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("reach", [1e-3, 1.0, 650.0])
def test_logarithms(seed, reach):
    x = np.exp(np.random.default_rng(seed).uniform(-reach, reach, BLOCK))
    found = x.copy()
    logarithms(found, np.empty(BLOCK, np.int64), BLOCK)
    np.testing.assert_allclose(found, np.log(x), rtol=4 * ULP, atol=2 * ULP)


@pytest.mark.parametrize("z", [-37.0, -8.0, -3.0, -1e-9, 0.0, 0.3, 2.0, 9.0, 60.0])
def test_the_cdf_of_one_normal(z):
    scratch = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK, np.int64)
    one = np.ones(1)
    cdf, density = mixture_cdf(z, one, 0 * one, one, *scratch)
    assert cdf == pytest.approx(ndtr(z), rel=1e-12, abs=1e-300)
    assert density == pytest.approx(np.exp(-z * z / 2) / np.sqrt(2 * np.pi), rel=1e-12, abs=1e-300)
