"""The compiled kernels against the NumPy oracle, from the same draws."""

import numpy as np
import pytest

from estimator import kernels, reference
from estimator.compiled import CompiledSteps
from estimator.kalman import pack
from estimator.liu_west import Kernel
from estimator.presets import PRESETS, SOLAR_APERTURE, network
from estimator.reference import ReferenceSteps
from estimator.space import parameter_space

RTOL = 1e-9
COUNTS = (1, 63, 64, 65, 200)


def setup(name, seed, logit, count, fixed=()):
    preset = network(name).with_fixed(fixed)
    if name == "titethria":
        preset = preset.with_solar("T_i", SOLAR_APERTURE)
    rng = np.random.default_rng(seed)
    space = parameter_space(preset, logit=logit)
    coordinates = space.from_uniform(rng.random((len(space.free), count)))
    n_x = len(preset.nodes)
    roots = rng.normal(size=(count, n_x, n_x))
    covariance = pack(roots @ roots.transpose(0, 2, 1) + 0.01 * np.eye(n_x))
    mean = 20 + 3 * rng.normal(size=(n_x, count))
    noise = np.exp(rng.normal(size=(n_x, count)) - 4)
    inputs = np.where(np.arange(len(preset.inputs)) < len(preset.boundaries), 5.0, 700.0)
    return preset, space, coordinates, mean, covariance, noise, inputs


@pytest.mark.parametrize("logit", [True, False])
@pytest.mark.parametrize("name", PRESETS)
def test_propagate(name, logit):
    for seed, count in enumerate(COUNTS):
        preset, space, *arrays = setup(name, seed, logit, count)
        expected = ReferenceSteps(preset, space, 600.0).propagate(*arrays)
        actual = CompiledSteps(preset, space, 600.0).propagate(*arrays)
        np.testing.assert_allclose(actual[0], expected[0], rtol=RTOL)
        np.testing.assert_allclose(actual[1], expected[1], rtol=RTOL, atol=1e-12)


def test_propagate_with_fixed_parameters_and_with_none_free():
    for fixed in (["C_i", "C_h", "C_s", "g_is"], [p.name for p in network("building-67").parameters]):
        preset, space, *arrays = setup("building-67", 5, True, 70, fixed)
        expected = ReferenceSteps(preset, space, 600.0).propagate(*arrays)
        actual = CompiledSteps(preset, space, 600.0).propagate(*arrays)
        np.testing.assert_allclose(actual[0], expected[0], rtol=RTOL)


@pytest.mark.parametrize("period", [1.0, 60.0, 3600.0, 86400.0])
def test_propagate_over_short_and_long_steps(period):
    preset, space, *arrays = setup("m8", 2, True, 130)
    expected = ReferenceSteps(preset, space, period).propagate(*arrays)
    actual = CompiledSteps(preset, space, period).propagate(*arrays)
    np.testing.assert_allclose(actual[0], expected[0], rtol=RTOL)
    np.testing.assert_allclose(actual[1], expected[1], rtol=RTOL, atol=1e-12)


@pytest.mark.parametrize("node", range(5))
def test_assimilate(node):
    for seed, count in enumerate(COUNTS):
        preset, space, _, mean, covariance, _, _ = setup("building-67", seed, True, count)
        expected = ReferenceSteps(preset, space, 600.0).assimilate(mean, covariance, node, 21.3, 0.15**2)
        actual = CompiledSteps(preset, space, 600.0).assimilate(mean, covariance, node, 21.3, 0.15**2)
        for name in expected._fields:
            np.testing.assert_allclose(
                getattr(actual, name), getattr(expected, name), rtol=RTOL, atol=1e-12, err_msg=name
            )


@pytest.mark.parametrize("logit", [True, False])
def test_moments_rejuvenation_and_point_estimate(logit):
    for seed, count in enumerate(COUNTS):
        preset, space, coordinates, *_ = setup("ecolar-6r4c", seed, logit, count)
        rng = np.random.default_rng(seed)
        weights = rng.dirichlet(np.full(count, 0.3))
        oracle, compiled = ReferenceSteps(preset, space, 300.0), CompiledSteps(preset, space, 300.0)
        for actual, expected in zip(
            compiled.moments(coordinates, weights), oracle.moments(coordinates, weights), strict=True
        ):
            np.testing.assert_allclose(actual, expected, rtol=RTOL, atol=1e-11)
        np.testing.assert_allclose(
            compiled.mean_log_parameters(coordinates, weights),
            oracle.mean_log_parameters(coordinates, weights),
            rtol=RTOL,
        )
        kernel = Kernel(0.9, rng.normal(size=10), np.tril(rng.normal(size=(10, 10))), False)
        normals = rng.normal(size=coordinates.shape)
        np.testing.assert_allclose(
            compiled.rejuvenate(coordinates, kernel, normals),
            oracle.rejuvenate(coordinates, kernel, normals),
            rtol=RTOL,
            atol=1e-12,
        )
        index = rng.integers(0, count, count)
        np.testing.assert_array_equal(compiled.gather(coordinates, index), oracle.gather(coordinates, index))


@pytest.mark.parametrize("seed", range(5))
def test_mixture_quantiles(seed):
    rng = np.random.default_rng(seed)
    count = 500
    weights = rng.dirichlet(np.full(count, 0.05))
    means, sds = 20 + rng.standard_t(2, count), np.exp(rng.normal(-2, 1.5, count))
    for level in (1e-4, 0.025, 0.25, 0.5, 0.9, 0.975, 0.9999):
        actual = kernels.mixture_quantile(level, weights, means, sds)
        assert actual == pytest.approx(reference.mixture_quantile(level, weights, means, sds), rel=RTOL)


def test_the_quantile_of_a_bimodal_mixture_lies_in_its_gap():
    weights, means, sds = np.array([0.5, 0.5]), np.array([10.0, 30.0]), np.array([0.1, 0.1])
    for quantile in (kernels.mixture_quantile, reference.mixture_quantile):
        assert quantile(0.25, weights, means, sds) == pytest.approx(10.0, abs=1e-9)
        assert 10.5 < quantile(0.5, weights, means, sds) < 29.5


def test_one_heavy_particle_gives_its_normal_quantile():
    weights = np.zeros(1000)
    weights[7] = 1.0
    means, sds = np.full(1000, 5.0), np.full(1000, 2.0)
    assert kernels.mixture_quantile(0.975, weights, means, sds) == pytest.approx(5 + 2 * 1.959963984540054, rel=1e-12)
