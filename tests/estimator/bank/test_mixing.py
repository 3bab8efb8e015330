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
def test_a_wild_member_goes_as_far_as_the_reach(reach):
    parts = [gaussian(20.0), gaussian(20.5), gaussian(80.0, 9.0)]
    whole = mixed(parts, shares(1, 1, 1), 1.0, reach)
    np.testing.assert_allclose(whole.means[0], [max(20.0, 20.5 - reach), 20.5, 20.5 + reach])
    np.testing.assert_array_equal(whole.sds[0], [1.0, 1.0, 9.0])


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
    middle = mixed(own, weights[:, 0], 1.0, 0.0)
    assert np.unique(middle.mean()).size == 1
