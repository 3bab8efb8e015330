"""EKF and UKF: a Kalman filter where nothing is unknown, learners where nothing disturbs, and sound numbers always."""

from dataclasses import replace

import numpy as np
import pytest
from support.small_building import PERIOD, TRUTH, building, known, record, textbook_kalman

from estimator.gaussian.square_root import Gaussian, condition_on, scalar_update, triangular_root
from estimator.network.presets import network
from estimator.registry import build
from estimator.types import Outcome

FILTERS = ["ekf", "ukf"]
QUIET = {"measurement_sd": 0.05, "process_sd": 0.001, "parameter_sd": 1e-4}


def run(estimator, data, first=0):
    """The posteriors of every sample after the first, and the forecasts that stood for them."""
    state = estimator.start(1, data.outputs[first], data.inputs[first])
    posteriors, mixtures = [], []
    for k in range(first, len(data.outputs) - 1):
        state = estimator.predict(state, data.inputs[k])
        mixtures.append(estimator.predictive(state))
        posteriors.append(estimator.update(state, data.outputs[k + 1]))
        state = posteriors[-1].state
    return posteriors, mixtures


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", FILTERS)
def test_with_known_parameters_they_are_the_kalman_filter(name, seed):
    """Two measured outputs, one after the other, against the matrix form of the textbook."""
    net = replace(known(building()), measured=("T_i", "T_e"))
    data = record(200, seed)
    data = data._replace(outputs=data.states + 0.05 * np.random.default_rng(seed).standard_normal(data.states.shape))
    estimator = build(name, net, PERIOD, QUIET | {"process_sd": 0.02})
    posteriors, mixtures = run(estimator, data)
    start = estimator.start(1, data.outputs[0], data.inputs[0])
    means, sds, total = textbook_kalman(
        net, TRUTH, PERIOD, (start.mean, start.root @ start.root.T), data, 0.02, 0.05, [0, 1]
    )
    np.testing.assert_allclose([m.means[:, 0] for m in mixtures], means, rtol=1e-9)
    np.testing.assert_allclose([m.sds[:, 0] for m in mixtures], sds, rtol=1e-9)
    assert sum(p.log_likelihood for p in posteriors) == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", FILTERS)
def test_without_disturbances_they_find_the_parameters(name, seed):
    data = record(3000, seed, process_sd=0.001)
    estimator = build(name, building(), PERIOD, QUIET)
    posteriors, mixtures = run(estimator, data)
    truth = np.array([TRUTH[p.name] for p in building().parameters])
    start = np.abs(estimator.start(1, data.outputs[0], data.inputs[0]).mean[2:] - np.log(truth))
    found = np.abs(np.log(posteriors[-1].parameters / truth))
    assert (found < 0.05).all(), found
    assert (start > 0.2).all(), "there was something to find"
    residual = data.outputs[1000:, 0] - [m.means[0, 0] for m in mixtures[999:]]
    inside = np.abs(residual) < 1.96 * np.array([m.sds[0, 0] for m in mixtures[999:]])
    assert 0.93 < inside.mean() < 0.97


@pytest.mark.parametrize("name", FILTERS)
def test_summaries_close_in_on_the_truth(name):
    data = record(1500, 4, process_sd=0.001)
    estimator = build(name, building(), PERIOD, QUIET)
    levels = np.array([0.001, 0.5, 0.999])
    posteriors, _ = run(estimator, data)
    early, late = (estimator.parameters(posteriors[k].state, levels) for k in (10, -1))
    loss = 1 / (1 / TRUTH["g_ie"] + 1 / TRUTH["g_e_out"])
    for parameter, quantiles in zip(building().parameters, late.parameters, strict=True):
        assert quantiles[1] == pytest.approx(TRUTH[parameter.name], rel=0.15)
    assert np.ptp(late.heat_loss) < 0.1 * np.ptp(early.heat_loss)
    assert late.heat_loss[1] == pytest.approx(loss, rel=0.01)


def narrowed(factor):
    """The building with all parameters known to within `factor`."""
    net = building()
    for name, value in TRUTH.items():
        net = net.with_parameter(name, lower=value / factor, upper=value * factor)
    return net


def apart(width, reach):
    """How far EKF and UKF are apart after six steps, in mean and in relative covariance."""
    data, net = record(10, 1), narrowed(np.exp(width))
    states = []
    for name, options in (("ekf", {}), ("ukf", {"sigma_reach": reach})):
        estimator = build(name, net, PERIOD, {"process_sd": 1e-6, "parameter_sd": 0.0} | options)
        states.append(estimator.start(1, data.outputs[0], data.inputs[0]))
        for k in range(6):
            states[-1] = estimator.predict(states[-1], data.inputs[k])
    left, right = (state.root @ state.root.T for state in states)
    return np.abs(states[0].mean - states[1].mean).max(), np.abs(left - right).max() / np.abs(left).max()


@pytest.mark.parametrize("reach", [0.05, 1.0, np.sqrt(3)])
def test_ekf_and_ukf_agree_in_the_linear_limit(reach):
    """What sets them apart is of second order in the spread of the parameters."""
    for wide, narrow in zip(apart(0.1, reach), apart(0.01, reach), strict=True):
        assert 0 < narrow < wide / 80


@pytest.mark.parametrize("name", FILTERS)
def test_a_measurement_beyond_belief_is_refused_and_the_prior_kept(name):
    data = record(30, 2)
    estimator = build(name, building(), PERIOD, {})
    state = estimator.predict(run(estimator, data)[0][-1].state, data.inputs[0])
    for y in (1e4, -1e9, 1.7e308):
        posterior = estimator.update(state, np.array([y]))
        assert posterior.outcome is Outcome.VANISHED
        assert np.isnan(posterior.log_likelihood)
        assert (posterior.gate, posterior.regime, posterior.effective_sample_size) == (None, None, None)
        assert posterior.state is state


@pytest.mark.parametrize("name", FILTERS)
def test_covariances_stay_definite_through_hard_times(name):
    """Jumps of 10 K, gaps and restarts, with a process noise of almost nothing, on every state of a stiff building."""
    net = network("building-67")
    estimator = build(name, net, 600.0, {"process_sd": 1e-6, "parameter_sd": 0.0, "measurement_sd": 0.01})
    rng = np.random.default_rng(1)
    inputs = np.array([5.0, 800.0, 200.0])
    state = estimator.start(1, np.array([20.0]), inputs)
    for k in range(400):
        state = estimator.predict(state, inputs * rng.uniform(0, 2, 3))
        y = np.nan if k % 7 == 0 else 20 + 10 * (k % 5 == 0) + rng.standard_normal()
        state = estimator.update(state, np.array([y])).state
        if k % 100 == 99:
            state = estimator.restart(state, np.array([20.0]), inputs)
        covariance = state.root @ state.root.T
        assert np.isfinite(covariance).all()
        assert np.linalg.eigvalsh(covariance).min() > -1e-12 * np.linalg.eigvalsh(covariance).max()
        assert (np.diag(covariance) > 0).all()


@pytest.mark.parametrize("name", FILTERS)
def test_parameters_that_the_data_say_nothing_about_get_no_wider_than_their_prior(name):
    estimator = build(name, building(), PERIOD, {"parameter_sd": 0.2})
    data = record(2, 1)
    state = estimator.start(1, data.outputs[0], data.inputs[0])
    for _ in range(300):
        state = estimator.predict(state, data.inputs[0])
    spread = np.sqrt(np.diag(state.root @ state.root.T))[2:]
    np.testing.assert_allclose(spread, np.log(30) / np.sqrt(12), rtol=1e-9)


@pytest.mark.parametrize("name", FILTERS)
def test_a_restart_keeps_what_was_learned_about_the_parameters(name):
    data = record(300, 5)
    estimator = build(name, building(), PERIOD, QUIET)
    learned = run(estimator, data)[0][-1].state
    again = estimator.restart(learned, np.array([15.0]), data.inputs[0])
    before, after = (state.root @ state.root.T for state in (learned, again))
    np.testing.assert_array_equal(again.mean, [15.0, 15.0, *learned.mean[2:]])
    np.testing.assert_allclose(after[2:, 2:], before[2:, 2:], rtol=1e-9)
    np.testing.assert_allclose(after[:2], np.hstack([np.diag([0.5**2, 3.0**2]), np.zeros((2, 4))]))


@pytest.mark.parametrize("name", FILTERS)
def test_a_fan_is_step_after_step(name):
    data = record(60, 0)
    estimator = build(name, building(), PERIOD, {})
    state = run(estimator, data)[0][-1].state
    fan = estimator.unfold(state, data.inputs[:30])
    for ahead, inputs in enumerate(data.inputs[:30]):
        for of_fan, of_step in zip(fan.at(ahead), estimator.predictive(state), strict=True):
            np.testing.assert_allclose(of_fan, of_step, rtol=1e-9)
        state = estimator.predict(state, inputs)
    assert len(fan.means) == 31
    assert fan.at(30).mean() == pytest.approx(estimator.predictive(state).mean(), rel=1e-9)


def test_a_square_root_update_is_the_textbook_one():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((6, 6))
    covariance = root @ root.T
    np.testing.assert_allclose(triangular_root(root.T) @ triangular_root(root.T).T, covariance)
    mean = rng.standard_normal(6)
    after, _ = scalar_update(Gaussian(mean, root), 2, 1.5, 0.3)
    gain = covariance[:, 2] / (covariance[2, 2] + 0.3)
    np.testing.assert_allclose(after.mean, mean + gain * (1.5 - mean[2]))
    np.testing.assert_allclose(after.root @ after.root.T, covariance - np.outer(gain, covariance[2]))
    conditioned = condition_on(Gaussian(mean, root), 4, 9.0)
    np.testing.assert_allclose(conditioned.mean, mean + covariance[:, 4] / covariance[4, 4] * (9.0 - mean[4]))
