"""The elementary functions over lanes against NumPy's and SciPy's."""

import numpy as np
import pytest
from numba import njit
from scipy.special import expit, ndtr

from estimator.kernels.elementary import exponential, logarithm, sigmoid
from estimator.kernels.lanes import JIT, LANES, load, store, within
from estimator.kernels.quantiles import mixture_cdf

ULP = np.finfo(float).eps
COUNT = 1003


def over_arrays(function):
    @njit(**JIT)
    def run(x, out):
        for first in range(0, x.shape[0], LANES):
            inside = within(first, x.shape[0])
            store(out, (first,), inside, function(load(x, (first,), inside)))

    def apply(x):
        out = np.empty_like(x)
        run(x, out)
        return out

    return apply


exponentials, logarithms, sigmoids = map(over_arrays, (exponential, logarithm, sigmoid))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("reach", [0.1, 5.0, 700.0])
def test_exponential(seed, reach):
    x = np.random.default_rng(seed).uniform(-reach, reach, COUNT)
    np.testing.assert_allclose(exponentials(x), np.exp(x), rtol=4 * ULP)


def test_exponential_saturates():
    found = exponentials(np.array([-1e9, -np.inf, 1e9, 0.0, -0.0]))
    assert found[0] == found[1] < 1e-300
    assert 1e300 < found[2] < np.inf
    assert (found[3:] == 1.0).all()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("reach", [1e-3, 1.0, 650.0])
def test_logarithm(seed, reach):
    x = np.exp(np.random.default_rng(seed).uniform(-reach, reach, COUNT))
    np.testing.assert_allclose(logarithms(x), np.log(x), rtol=4 * ULP, atol=2 * ULP)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("reach", [1.0, 36.0])
def test_sigmoid(seed, reach):
    x = np.random.default_rng(seed).uniform(-reach, reach, COUNT)
    np.testing.assert_allclose(sigmoids(x), expit(x), rtol=6 * ULP)


@pytest.mark.parametrize("z", [-37.0, -8.0, -3.0, -1e-9, 0.0, 0.3, 2.0, 9.0, 39.0])
def test_the_tail_of_one_normal(z):
    one = np.ones(1)
    above, density, slope = mixture_cdf(z, one, 0 * one, one)
    assert above == pytest.approx(ndtr(-z), rel=3e-12, abs=1e-300)
    assert density == pytest.approx(np.exp(-z * z / 2) / np.sqrt(2 * np.pi), rel=1e-12, abs=1e-300)
    assert slope == pytest.approx(-z * density, rel=1e-12)
