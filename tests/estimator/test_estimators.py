"""One list of checks, run over every online estimator."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
from support.forecasts import unfolded

from estimator.blackbox.arx import ARX
from estimator.blackbox.daily import Daily
from estimator.blackbox.direct import Direct
from estimator.network.presets import PRESETS, network
from estimator.registry import ESTIMATORS, build
from estimator.types import Mixture

PERIOD = 300.0
SMALL = json.loads(Path(__file__).with_name("small.json").read_text(encoding="utf-8"))
VARIANTS = [(name, SMALL.get(name, {})) for name in ESTIMATORS]
VARIANTS += [(name, SMALL.get(name, {}) | {"preset": "paper"}) for name in ("rbpf", "ekf", "ukf")]
VARIANTS += [("mkf", SMALL["mkf"] | {"preset": preset}) for preset in ("drift", "free", "steady", "output-error")]


def make(name, options, preset="titethria"):
    return build(name, network(preset), PERIOD, options)


def inputs_of(estimator, step=0):
    boundaries = len(estimator.network.boundaries)
    return np.array([5.0] * boundaries + [500.0 * (step % 3 == 0)] * (len(estimator.network.inputs) - boundaries))


def run(estimator, state, steps, first=0):
    rng = np.random.default_rng(first)
    outputs = []
    for step in range(first, first + steps):
        state = estimator.predict(state, inputs_of(estimator, step))
        posterior = estimator.update(state, np.array([20 + 0.1 * rng.standard_normal()]))
        outputs.append(posterior)
        state = posterior.state
    return state, outputs


def start(estimator, seed=1):
    return estimator.start(seed, np.array([20.0]), inputs_of(estimator))


def arrays_of(estimator, state):
    """The arrays of a state, or of a mixture, by name."""
    return state._asdict() if isinstance(state, Mixture) else estimator.pack(state)


def assert_same_bits(estimator, left, right):
    left, right = arrays_of(estimator, left), arrays_of(estimator, right)
    assert left.keys() == right.keys()
    for name, a in left.items():
        assert a.dtype == right[name].dtype
        assert a.tobytes() == right[name].tobytes(), name


def check_same_seed_same_bits(estimator):
    assert_same_bits(estimator, run(estimator, start(estimator), 12)[0], run(estimator, start(estimator), 12)[0])


def check_another_seed_other_draws(estimator):
    left, right = (estimator.pack(start(estimator, seed)) for seed in (1, 2))
    differ = any(not np.array_equal(left[name], right[name]) for name in left if name != "seed")
    draws_nothing = (
        isinstance(estimator, ARX | Daily | Direct) or getattr(estimator.options, "initial", None) == "centre"
    )
    assert differ is not draws_nothing


def check_the_state_survives_npz_and_goes_on_with_the_same_bits(estimator):
    state, _ = run(estimator, start(estimator), 7)
    file = io.BytesIO()
    np.savez(file, **estimator.pack(state))
    file.seek(0)
    with np.load(file, allow_pickle=False) as stored:
        back = estimator.unpack({name: stored[name] for name in stored.files})
    assert_same_bits(estimator, run(estimator, state, 5, first=7)[0], run(estimator, back, 5, first=7)[0])


def check_nothing_passed_in_is_changed(estimator):
    state, _ = run(estimator, start(estimator), 5)
    before = [array.tobytes() for array in estimator.pack(state).values()]
    levels = np.array([0.1, 0.9])
    estimator.predict(state, inputs_of(estimator))
    estimator.update(state, np.array([20.0]))
    estimator.restart(state, np.array([20.0]), inputs_of(estimator))
    estimator.predictive(state)
    estimator.parameters(state, levels)
    unfolded(estimator, state, np.tile(inputs_of(estimator), (4, 1)))
    assert [array.tobytes() for array in estimator.pack(state).values()] == before


def check_a_forecast_repeats(estimator):
    state, _ = run(estimator, start(estimator), 5)
    plan = np.tile(inputs_of(estimator), (3, 1))
    first, second = (unfolded(estimator, state, plan) for _ in range(2))
    for left, right in zip(first, second, strict=True):
        assert_same_bits(estimator, left, right)


def check_an_issue_forecasts_what_the_state_does(estimator):
    state, _ = run(estimator, start(estimator), 15)
    plan = np.tile(inputs_of(estimator), (4, 1))
    issue = estimator.issue(state, 32)
    assert isinstance(issue, estimator.issue_type)
    later = list(estimator.unfold(issue, plan).each())
    assert len(later) == 5
    for own, whole in zip(later, unfolded(estimator, state, plan), strict=True):
        assert abs(own.mean()[0] - whole.mean()[0]) < 3.0 * whole.sd()[0]
        assert 0.2 * whole.sd()[0] < own.sd()[0] < 5.0 * whole.sd()[0]
    assert estimator.verified(state, 6, np.array([np.nan])) is not None


def check_a_missing_output_is_tolerated(estimator):
    posterior = estimator.update(estimator.predict(start(estimator), inputs_of(estimator)), np.array([np.nan]))
    assert np.isnan(posterior.log_likelihood)
    mixture = estimator.predictive(estimator.predict(posterior.state, inputs_of(estimator)))
    assert np.isfinite(mixture.mean()).all()
    assert np.isfinite(mixture.sd()).all()


def check_outliers_never_poison_the_state(estimator):
    state = start(estimator)
    for y in (1e9, -1e9, 20.0, 1e300, 20.0):
        state = estimator.update(estimator.predict(state, inputs_of(estimator)), np.array([y])).state
    for name, array in estimator.pack(state).items():
        assert np.isfinite(array.astype(float)).all(), name


def check_quantiles_increase_with_the_level(estimator):
    state = estimator.predict(start(estimator), inputs_of(estimator))
    levels = np.array([0.01, 0.1, 0.5, 0.9, 0.99])
    assert (np.diff(estimator.predictive(state).quantiles(levels, 0)) > 0).all()
    for name, quantiles in estimator.parameters(state, levels)._asdict().items():
        assert (np.diff(quantiles) >= 0).all() or not estimator.physical, name


def check_parameters_stay_in_their_box(estimator):
    state = start(estimator)
    rng = np.random.default_rng(3)
    for step in range(60):
        state = estimator.predict(state, inputs_of(estimator, step))
        posterior = estimator.update(state, np.array([20 + 3 * rng.standard_normal()]))
        state = posterior.state
        for parameter, value in zip(estimator.network.parameters, posterior.parameters, strict=True):
            within = parameter.lower * (1 - 1e-9) <= value <= parameter.upper * (1 + 1e-9)
            assert within or not estimator.physical, parameter.name


def check_a_summary_has_one_entry_per_block(estimator):
    posterior = run(estimator, start(estimator), 3)[1][-1]
    assert posterior.alpha_quantiles.shape == (len(estimator.blocks), 3)
    assert posterior.cdf.shape == (len(estimator.blocks),)
    assert posterior.gate is None if not estimator.blocks else 0 < posterior.gate <= 1


CHECKS = [value for name, value in list(globals().items()) if name.startswith("check_")]


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__.removeprefix("check_"))
@pytest.mark.parametrize(("name", "options"), VARIANTS, ids=lambda part: str(part))
def test_estimator(name, options, check):
    check(make(name, options))


# Kernels are compiled for each number of states, which takes half a minute: these have two, three and five.
@pytest.mark.parametrize("preset", [preset for preset in PRESETS if len(network(preset).nodes) != 4])
@pytest.mark.parametrize(("name", "options"), VARIANTS, ids=lambda part: str(part))
def test_every_estimator_runs_networks_of_every_kind(name, options, preset):
    estimator = make(name, options, preset)
    state, posteriors = run(estimator, start(estimator), 6)
    assert all(np.isfinite(p.log_likelihood) for p in posteriors)
    assert posteriors[-1].parameters.shape == (len(estimator.network.parameters),)
    assert np.isfinite(estimator.predictive(state).sd()).all()
