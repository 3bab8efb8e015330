"""The compiled kernels against the NumPy oracle, from the same draws."""

import numpy as np
import pytest
from support.forecasts import mixture_quantile

from estimator.kernels.draws import Draws
from estimator.network.presets import PRESETS, SOLAR_APERTURE, network
from estimator.network.space import parameter_space
from estimator.particle.compiled import CompiledSteps
from estimator.particle.kalman import pack
from estimator.particle.liu_west import Kernel
from estimator.particle.options import resolve
from estimator.particle.reference import ReferenceSteps
from estimator.particle.resampling import reweigh
from estimator.types import Mixture

RTOL = 1e-9
COUNTS = (1, 7, 8, 9, 200)


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
    log_alpha = rng.normal(size=(2, count))
    inputs = np.where(np.arange(len(preset.inputs)) < len(preset.boundaries), 5.0, 700.0)
    return preset, space, coordinates, mean, covariance, log_alpha, inputs


def both(preset, space, period=600.0):
    """The oracle and the compiled steps, with the states in two volatility blocks."""
    block = np.arange(len(preset.nodes), dtype=np.int64) % 2
    return ReferenceSteps(preset, space, period, block, 0.01), CompiledSteps(preset, space, period, block, 0.01)


def assert_propagated_alike(made, period=600.0):
    preset, space, *arrays = made
    oracle, compiled = both(preset, space, period)
    expected, actual = oracle.propagate(*arrays), compiled.propagate(*arrays)
    np.testing.assert_allclose(actual[0], expected[0], rtol=RTOL)
    np.testing.assert_allclose(actual[1], expected[1], rtol=RTOL, atol=1e-12)


@pytest.mark.parametrize("logit", [True, False])
@pytest.mark.parametrize("name", PRESETS)
def test_propagate(name, logit):
    for seed, count in enumerate(COUNTS):
        assert_propagated_alike(setup(name, seed, logit, count))


def test_propagate_with_fixed_parameters_and_with_none_free():
    for fixed in (["C_i", "C_h", "C_s", "g_is"], [p.name for p in network("building-67").parameters]):
        assert_propagated_alike(setup("building-67", 5, True, 70, fixed))


@pytest.mark.parametrize("period", [1.0, 60.0, 3600.0, 86400.0])
def test_propagate_over_short_and_long_steps(period):
    assert_propagated_alike(setup("m8", 2, True, 130), period)


def test_reweigh_takes_a_broken_particle_for_impossible():
    for seed, count in enumerate(COUNTS[1:]):
        log_weights = 30 * np.random.default_rng(seed).normal(size=count) - 600
        log_weights[:3] = np.nan, -np.inf, -1e300
        found = reweigh(log_weights)
        kept = np.exp(log_weights[3:] - log_weights[3:].max())
        np.testing.assert_allclose(found.weights, [0, 0, 0, *kept / kept.sum()], rtol=RTOL, atol=1e-300)
        assert found.log_sum == pytest.approx(log_weights[3:].max() + np.log(kept.sum()), rel=RTOL)
        assert found.effective_sample_size == pytest.approx(kept.sum() ** 2 / (kept**2).sum(), rel=RTOL)
        assert np.isneginf(found.log_weights[:2]).all()
        np.testing.assert_allclose(found.log_weights[3:], log_weights[3:] - found.log_sum, rtol=RTOL, atol=1e-9)


def test_moments():
    for seed, count in enumerate(COUNTS):
        preset, space, coordinates, *_ = setup("ecolar-6r4c", seed, True, count)
        weights = np.random.default_rng(seed).dirichlet(np.full(count, 0.3))
        found = zip(*(steps.moments(coordinates, weights) for steps in both(preset, space, 300.0)), strict=True)
        for expected, actual in found:
            np.testing.assert_allclose(actual, expected, rtol=RTOL, atol=1e-11)


@pytest.mark.parametrize("blocks", [1, 2])
def test_outputs_ahead(blocks):
    preset, space, coordinates, mean, covariance, log_alpha, inputs = setup("building-67", 3, True, 9)
    options, nodes = resolve(preset, 600.0, {"jump_probability": 0.3}), np.array([0, 3])
    plan = inputs * np.array([1.0, 0.9, 0.0, 2.0])[:, None]
    found = []
    for kind in (ReferenceSteps, CompiledSteps):
        steps = kind(preset, space, 600.0, np.arange(5) % blocks, 0.01)
        means, variances = np.empty((4, 2, 9)), np.empty((4, 2, 9))
        now = Draws(7, 20, forecast=True)
        steps.outputs_ahead(
            coordinates, mean, covariance, log_alpha[:blocks], plan, options, now, nodes, means, variances
        )
        found.append((means, variances))
    np.testing.assert_allclose(found[1], found[0], rtol=RTOL)


LEVELS = np.array([1e-6, 1e-4, 0.025, 0.25, 0.5, 0.9, 0.975, 0.9999, 1 - 1e-6])


def quantiles(weights, means, sds, levels=LEVELS):
    mixture = Mixture(weights, means[None], sds[None])
    expected = np.array([mixture_quantile(level, weights, means, sds) for level in levels])
    return expected, mixture.quantiles(np.array(levels), 0)


@pytest.mark.parametrize("seed", range(8))
def test_mixture_quantiles(seed):
    rng = np.random.default_rng(seed)
    count = 500 + seed
    weights = rng.dirichlet(np.full(count, 0.05))
    means, sds = 20 + rng.standard_t(2, count), np.exp(rng.normal(-2, 1.5, count))
    expected, actual = quantiles(weights, means, sds)
    np.testing.assert_allclose(actual, expected, rtol=RTOL)
    assert (np.diff(actual) > 0).all()


def test_the_quantile_of_a_bimodal_mixture_lies_in_its_gap():
    for found in quantiles(np.array([0.5, 0.5]), np.array([10.0, 30.0]), np.array([0.1, 0.1]), (0.25, 0.5)):
        assert found[0] == pytest.approx(10.0, abs=1e-9)
        assert 10.5 < found[1] < 29.5


def test_one_heavy_particle_gives_its_normal_quantile():
    weights = np.zeros(1000)
    weights[7] = 1.0
    for found in quantiles(weights, np.full(1000, 5.0), np.full(1000, 2.0), (0.975,)):
        assert found[0] == pytest.approx(5 + 2 * 1.959963984540054, rel=1e-12)


@pytest.mark.parametrize("logit", [True, False])
def test_bits_do_not_depend_on_where_arrays_lie(logit):
    """The compiler may take another path where arrays are close neighbours; the result must be the same."""
    preset, space, *arrays = setup("ecolar-6r4c", 3, logit, 100)
    _, compiled = both(preset, space, 300.0)
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.full(100, 0.3))
    kernel = Kernel(0.9, rng.normal(size=10), np.tril(rng.normal(size=(10, 10))), False)

    def results(coordinates, mean, covariance, log_alpha, inputs, weights):
        predicted = compiled.propagate(coordinates, mean, covariance, log_alpha, inputs)
        assimilated = compiled.assimilate(mean, covariance, 0, 20.5, 0.01)
        mixture = Mixture(weights, mean[:1], np.sqrt(covariance[:1]))
        return [
            *predicted,
            *assimilated,
            *compiled.moments(coordinates, weights),
            compiled.rejuvenate(coordinates, kernel, Draws(1, 2)),
            compiled.walk(log_alpha, resolve(preset, 300.0, {}), Draws(1, 2)),
            reweigh(np.log(weights)).log_weights,
            compiled.mean_log_parameters(coordinates, weights),
            mixture.quantiles(np.array([0.1, 0.5]), 0),
        ]

    inputs = [*arrays, weights]
    expected = [array.tobytes() for array in results(*inputs)]
    sizes = sum(array.size for array in inputs)
    for trial in range(300):
        # Neighbours in one buffer, in changing order, a few numbers apart, with fresh outputs wherever they fall.
        buffer, moved, start = np.empty(sizes + 100), {}, int(rng.integers(0, 8))
        for place in rng.permutation(len(inputs)):
            array = inputs[place]
            moved[place] = buffer[start : start + array.size].reshape(array.shape)
            moved[place][...] = array
            start += array.size + int(rng.integers(0, 3))
        keep = [np.empty(int(rng.integers(1, 400))) for _ in range(trial % 7)]
        found = results(*(moved[place] for place in range(len(inputs))))
        assert [array.tobytes() for array in found] == expected
        del keep
