"""Liu-West rejuvenation (24)-(28), the two coordinate systems, and systematic resampling."""

import numpy as np
import pytest

from estimator.network.presets import network
from estimator.network.space import parameter_space
from estimator.particle.liu_west import liu_west_kernel, moments, rejuvenate
from estimator.particle.options import resolve
from estimator.particle.resampling import systematic

BUILDING = network("building-67")


def options(**given):
    return resolve(BUILDING, 600.0, {"preset": "paper"} | given)


def test_the_paper_kernel_has_the_papers_coefficients():
    paper = options()
    covariance = np.diag([4.0, 9.0])
    assert paper.shrinkage == pytest.approx((3 * 0.95 - 1) / (2 * 0.95))
    for gate in (0.05, 0.5, 1.0):
        kernel = liu_west_kernel(np.zeros(2), covariance, gate, paper)
        assert kernel.shrink == pytest.approx(1 - gate * (1 - paper.shrinkage))
        np.testing.assert_allclose(kernel.jitter @ kernel.jitter.T, gate * (1 - paper.shrinkage**2) * covariance)


@pytest.mark.parametrize("preserving", [True, False])
def test_what_the_gate_does_to_the_variance(preserving):
    """The paper's h^2 = g h_0^2 loses variance for every gate below 1; h^2 = 1 - a^2 keeps it."""
    chosen = options(moment_preserving=preserving)
    for gate in (0.05, 0.5):
        kernel = liu_west_kernel(np.zeros(1), np.ones((1, 1)), gate, chosen)
        kept = kernel.shrink**2 + kernel.jitter[0, 0] ** 2
        assert (kept == pytest.approx(1.0)) if preserving else (kept < 1)


def test_rejuvenation_keeps_mean_and_covariance():
    count, rng = 200_000, np.random.default_rng(0)
    coordinates = rng.normal(size=(2, count)) * [[1.0], [3.0]] + [[0.5], [-2.0]]
    coordinates[1] += coordinates[0]
    weights = np.full(count, 1 / count)
    mean, covariance = moments(coordinates, weights)
    np.testing.assert_allclose(covariance, np.cov(coordinates, ddof=0))
    kernel = liu_west_kernel(mean, covariance, 0.7, options(moment_preserving=True))
    after = moments(rejuvenate(coordinates, kernel, rng.normal(size=coordinates.shape)), weights)
    spread = np.sqrt(np.diag(covariance))
    # Five standard errors of a mean and of a variance over this many draws.
    np.testing.assert_allclose(after[0], mean, atol=5 * spread.max() / np.sqrt(count))
    np.testing.assert_allclose(after[1], covariance, atol=5 * np.sqrt(2 / count) * np.outer(spread, spread).max())


def without_data(coordinates_kind, steps=1000, count=4000):
    space = parameter_space(BUILDING, logit=coordinates_kind == "logit")
    chosen = options(coordinates=coordinates_kind, moment_preserving=True)
    rng = np.random.default_rng(3)
    coordinates = space.from_uniform(rng.random((10, count)))
    weights = np.full(count, 1 / count)
    before = space.log_parameters(coordinates).var(axis=1)
    for _ in range(steps):
        kernel = liu_west_kernel(*moments(coordinates, weights), 1.0, chosen)
        coordinates = space.confine(rejuvenate(coordinates, kernel, rng.normal(size=coordinates.shape)))
    phi = space.log_parameters(coordinates)
    assert (phi >= space.lower[:, None] - 1e-12).all()
    assert (phi <= space.upper[:, None] + 1e-12).all()
    return phi.var(axis=1) / before


def test_without_data_clipping_learns_from_nothing_and_the_logit_box_does_not():
    clipped, boxed = without_data("log"), without_data("logit")
    assert clipped.max() < 0.6
    assert boxed.min() > 0.75


def test_a_collapsed_covariance_is_lifted_to_its_floor_and_reported():
    chosen = options(variance_floor=1e-4)
    kernel = liu_west_kernel(np.zeros(2), np.diag([1e-9, 1.0]), 1.0, chosen)
    assert kernel.floored
    assert kernel.jitter[0, 0] ** 2 == pytest.approx(1e-4 * (1 - chosen.shrinkage**2))
    assert not liu_west_kernel(np.zeros(2), np.eye(2), 1.0, chosen).floored


def test_a_singular_covariance_jitters_inside_its_range():
    covariance = np.outer([1.0, 2.0, -1.0], [1.0, 2.0, -1.0])
    kernel = liu_west_kernel(np.zeros(3), covariance, 1.0, options())
    assert np.isfinite(kernel.jitter).all()
    scale = 1 - options().shrinkage ** 2
    np.testing.assert_allclose(kernel.jitter @ kernel.jitter.T, scale * covariance, atol=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_systematic_resampling_copies_each_particle_its_share_up_to_one(seed):
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet(np.full(100, 0.1))
    copies = np.bincount(systematic(weights, rng.random()), minlength=100)
    assert copies.sum() == 100
    assert (np.abs(copies - 100 * weights) < 1 + 1e-9).all()


def test_systematic_resampling_at_the_ends_of_the_uniform():
    for uniform in (0.0, np.nextafter(1.0, 0.0)):
        index = systematic(np.full(7, 1 / 7), uniform)
        assert index.min() >= 0
        assert index.max() <= 6
    np.testing.assert_array_equal(systematic(np.array([0.0, 1.0, 0.0]), 0.5), [1, 1, 1])
