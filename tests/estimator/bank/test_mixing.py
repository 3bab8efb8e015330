"""The members' forecasts made one: nobody is far from the middle while little was verified; later everybody counts."""

import numpy as np
import pytest

from estimator.bank.mixing import mixed, mixed_futures
from estimator.types import Mixture, Mixtures

FAR = 1e6


def gaussian(mean, sd=1.0):
    return Mixture(np.ones(1), np.array([[mean]]), np.array([[sd]]))


def shares(*values):
    return np.array(values) / sum(values)


@pytest.mark.parametrize("reach", [0.0, 1.0, 3.0])
def test_a_wild_member_goes_as_far_as_the_reach_and_spreads_four_times_that(reach):
    parts = [gaussian(20.0), gaussian(20.5), gaussian(80.0, 9.0)]
    whole = mixed(parts, shares(1, 1, 1), 1.0, reach)
    np.testing.assert_allclose(whole.means[0], [max(20.0, 20.5 - reach), 20.5, 20.5 + reach])
    np.testing.assert_allclose(whole.sds[0], np.minimum([1.0, 1.0, 9.0], 4.0 * reach))


def middle_of(values, weights):
    """Weighted median: halfway between two where exactly half of the weight is on either side."""
    values, weights = zip(*sorted(zip(values, weights, strict=True)), strict=True)
    below = np.cumsum(weights)
    lower = next(value for value, sum_ in zip(values, below, strict=True) if sum_ >= 0.5 - 1e-9)
    upper = next(value for value, sum_ in zip(values, below, strict=True) if sum_ > 0.5 + 1e-9)
    return 0.5 * (lower + upper)


def textbook(parts, weights, scale, reach):
    """The mixture of one output as it would be written down: held within the reach, weighted, stretched."""
    means, sds = [part.mean()[0] for part in parts], [part.sd()[0] for part in parts]
    middle, limit = middle_of(means, weights), reach * middle_of(sds, weights)
    near = np.clip(means, middle - limit, middle + limit)
    narrower = np.minimum(4.0 * limit / np.array(sds), 1.0)
    components = [
        (weight * share / part.weights.sum(), centre + narrow * (at - mean), narrow * sd)
        for part, mean, centre, narrow, weight in zip(parts, means, near, narrower, weights, strict=True)
        for share, at, sd in zip(part.weights, part.means[0], part.sds[0], strict=True)
    ]
    whole = Mixture(*(np.array(row) for row in zip(*components, strict=True)))
    centre = sum(whole.weights * whole.means)
    return Mixture(whole.weights, centre + scale * (whole.means - centre), scale * whole.sds)


@pytest.mark.parametrize("seed", range(40))
def test_the_compiled_mixture_is_that_of_the_textbook(seed):
    rng = np.random.default_rng(seed)
    counts, scale, reach = (
        rng.integers(1, 9, rng.integers(1, 8)),
        rng.uniform(0.3, 3.0),
        rng.choice([0.0, 0.7, 2.0, FAR]),
    )
    parts = [
        Mixture(rng.dirichlet(np.ones(n)), 20.0 + 3.0 * rng.normal(size=(1, n)), rng.uniform(0.05, 2.0, (1, n)))
        for n in counts
    ]
    # Members that weigh the same share the middle between them.
    weights = shares(*np.ones(len(parts))) if seed % 2 else rng.dirichlet(np.ones(len(parts)))
    expected, found = textbook(parts, weights, scale, reach), mixed(parts, weights, scale, reach)
    np.testing.assert_allclose(found.weights, expected.weights, atol=1e-12)
    np.testing.assert_allclose(found.means[0], expected.means, atol=1e-9)
    np.testing.assert_allclose(found.sds[0], expected.sds, atol=1e-12)


def test_every_lead_and_output_has_a_middle_of_its_own():
    rng = np.random.default_rng(1)
    weights, scales, reaches = (
        rng.dirichlet(np.ones(3), 4).T,
        np.array([1.0, 0.5, 2.0, 1.0]),
        np.array([0.0, 0.5, 2.0, FAR]),
    )
    futures = [
        Mixtures(rng.dirichlet(np.ones(n), 4), 20.0 + rng.normal(size=(4, 2, n)), rng.uniform(0.1, 1.0, (4, 2, n)))
        for n in (1, 3, 5)
    ]
    whole = mixed_futures(futures, weights, scales, reaches)
    for lead in range(4):
        for output in range(2):
            parts = [one.at(lead) for one in futures]
            own = [Mixture(part.weights, part.means[[output]], part.sds[[output]]) for part in parts]
            one = mixed(own, weights[:, lead], scales[lead], reaches[lead])
            np.testing.assert_allclose(whole.means[lead, output], one.means[0])
            np.testing.assert_allclose(whole.sds[lead, output], one.sds[0])
    assert np.unique(mixed(own, weights[:, 0], 1.0, 0.0).mean()).size == 1
