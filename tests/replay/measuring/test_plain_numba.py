"""The plain Numba version of the particle step against the NumPy oracle: what is timed computes the same."""

import json
import subprocess
import sys

import numpy as np
import pytest

from estimator.kernels.draws import Draws
from estimator.network.presets import network
from estimator.network.space import parameter_space
from estimator.particle.kalman import pack
from estimator.particle.liu_west import Kernel
from estimator.particle.options import resolve
from estimator.particle.reference import ReferenceSteps
from estimator.types import Mixture
from replay.measuring.bench.plain.kernels import WIDTH
from replay.measuring.bench.plain.steps import PlainSteps
from replay.measuring.bench.sections.plain import build_plain
from replay.measuring.bench.workload import build, complete_update, samples, settled

RTOL = 1e-9
PERIOD = 600.0
COUNTS = (1, WIDTH - 1, WIDTH, 3 * WIDTH + 5)


def particles(seed, count, logit):
    preset = network("building-67")
    rng = np.random.default_rng(seed)
    space = parameter_space(preset, logit=logit)
    block = np.arange(len(preset.nodes), dtype=np.int64) % 2
    given = (preset, space, PERIOD, block, 0.01)
    roots = rng.normal(size=(count, 5, 5))
    return (
        ReferenceSteps(*given),
        PlainSteps(*given),
        rng,
        space.from_uniform(rng.random((10, count))),
        20 + 3 * rng.normal(size=(5, count)),
        pack(roots @ roots.transpose(0, 2, 1) + 0.01 * np.eye(5)),
        rng.normal(size=(2, count)),
    )


@pytest.mark.parametrize("logit", [True, False])
@pytest.mark.parametrize("count", COUNTS)
def test_every_step_agrees_with_the_oracle(count, logit):
    oracle, plain, rng, coordinates, mean, covariance, log_alpha = particles(count, count, logit)
    weights = rng.dirichlet(np.full(count, 0.3))
    kernel = Kernel(0.9, rng.normal(size=10), np.tril(rng.normal(size=(10, 10))), False)
    options = resolve(network("building-67"), PERIOD, {"jump_probability": 0.3, "volatility_sd": 0.4})
    mixture = Mixture(weights, mean[:1], np.sqrt(covariance[:1]))

    def results(steps):
        return {
            "walk": [steps.walk(log_alpha, options, Draws(count, 8))],
            "propagate": steps.propagate(coordinates, mean, covariance, log_alpha, np.array([5.0, 700.0, 300.0])),
            "assimilate": steps.assimilate(mean, covariance, 3, 21.3, 0.15**2),
            "predictive": steps.predictive(mean, covariance, log_alpha[0], np.array([0, 3]), 0.15**2),
            "reweigh": steps.reweigh(30 * log_alpha[0] - 600),
            "moments": steps.moments(coordinates, weights),
            "rejuvenate": [steps.rejuvenate(coordinates, kernel, Draws(count, 3))],
            "mean_log_parameters": [steps.mean_log_parameters(coordinates, weights)],
            "quantiles": [steps.quantiles(mixture, np.array([1e-4, 0.025, 0.5, 0.975]), 0)],
        }

    expected, actual = results(oracle), results(plain)
    for name, values in expected.items():
        for one, other in zip(actual[name], values, strict=True):
            # Weights that are nothing beside the largest may be anything so small.
            np.testing.assert_allclose(one, other, rtol=RTOL, atol=1e-11, err_msg=name)


def test_a_filter_on_plain_steps_publishes_the_same_forecasts():
    given = samples()
    compiled, plain = build(500), build_plain(500)
    state = settled(compiled, given, 20)
    for index in range(20, 30):
        step, other = (complete_update(one, state, *given.at(index)) for one in (compiled, plain))
        np.testing.assert_allclose(other.quantiles, step.quantiles, rtol=RTOL)
        state = step.state


def test_both_versions_are_timed_on_the_same_numbers():
    """In a process of its own, because the comparison keeps itself to one processor."""
    command = [sys.executable, "-m", "replay.measuring.bench.plain", "tiny"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["ratio"] > 0
    assert found["processor_ratio"] > 0
    assert found["first_updates_processor_s"].keys() == {"kernels", "plain"}
    assert found["plain"]["lower_quartile_s"] <= found["plain"]["median_s"]
    assert found["largest_difference_K"] < 1e-9
