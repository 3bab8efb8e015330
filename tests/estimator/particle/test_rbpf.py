"""The filter as a whole: exact where exactness is known, and defined where things go wrong."""

from dataclasses import replace

import numpy as np
import pytest
from support.small_building import Record, textbook_kalman

from estimator.kernels.draws import Draws
from estimator.network.network import InitialTemperature
from estimator.network.presets import network
from estimator.registry import build
from estimator.types import Outcome

PERIOD = 600.0
INPUTS = np.array([4.0, 800.0, 120.0])


def known_building():
    """Building 67 with every parameter held at the truth."""
    building = network("building-67")
    return building.with_fixed([p.name for p in building.parameters])


@pytest.mark.parametrize("implementation", ["compiled", "reference"])
@pytest.mark.parametrize("measured", [("T_i",), ("T_i", "T_m", "T_h")])
def test_with_known_parameters_and_volatility_it_is_the_kalman_filter(implementation, measured):
    net = replace(known_building(), measured=measured)
    net = replace(net, initial={node: InitialTemperature("measured", 0.2) for node in net.nodes})
    frozen = {"volatility_sd": 0.0, "alpha_initial_sd": 0.0, "jump_probability": 0.0, "particles": 50}
    chosen = frozen | {"measurement_sd": 0.15, "process_sd": 0.03, "implementation": implementation}
    estimator = build("rbpf", net, PERIOD, chosen)
    outputs = 20 + np.random.default_rng(1).normal(size=(30, len(measured)))
    outputs[0] = 20.0
    outputs[5] = np.nan
    outputs[9, -1] = np.nan
    rows = [net.nodes.index(name) for name in measured]
    data = Record(np.tile(INPUTS, (30, 1)), outputs, outputs)
    theta = {p.name: p.nominal for p in net.parameters}
    start = np.full(5, 20.0), np.eye(5) * 0.2**2
    means, sds, total = textbook_kalman(net, theta, PERIOD, start, data, 0.03, 0.15, rows)
    state = estimator.start(7, outputs[0], INPUTS)
    log_likelihood = 0.0
    for y, mean, sd in zip(outputs[1:], means, sds, strict=True):
        state = estimator.predict(state, INPUTS)
        mixture = estimator.predictive(state)
        np.testing.assert_allclose(mixture.mean(), mean, rtol=1e-9)
        np.testing.assert_allclose(mixture.sd(), sd, rtol=1e-9)
        for index in range(len(measured)):
            expected = mean[index] + 1.959963984540054 * sd[index]
            assert mixture.quantiles(np.array([0.975]), index)[0] == pytest.approx(expected, rel=1e-9)
        posterior = estimator.update(state, y)
        log_likelihood += 0.0 if np.isnan(posterior.log_likelihood) else posterior.log_likelihood
        state = posterior.state
    assert log_likelihood == pytest.approx(total, rel=1e-9)


def filtered(options, outputs, seed=5, net="building-67"):
    estimator = build("rbpf", network(net), PERIOD, {"particles": 300, "measurement_sd": 0.15} | options)
    state = estimator.start(seed, outputs[0], INPUTS)
    posteriors = []
    for y in outputs[1:]:
        posterior = estimator.update(estimator.predict(state, INPUTS), y)
        posteriors.append(posterior)
        state = posterior.state
    return estimator, posteriors


@pytest.mark.parametrize("preset", ["paper", "default"])
def test_both_implementations_go_the_same_way(preset):
    """Step by step from the same state, with the same draws."""
    rng = np.random.default_rng(2)
    net = network("building-67")
    compiled, oracle = (
        build("rbpf", net, PERIOD, {"preset": preset, "particles": 3000, "implementation": name})
        for name in ("compiled", "reference")
    )
    state = compiled.start(11, np.array([20.0]), INPUTS)
    for name, left, right in zip(state._fields, state, oracle.start(11, np.array([20.0]), INPUTS), strict=True):
        np.testing.assert_array_equal(left, right, err_msg=name)
    resampled = 0
    for step in range(60):
        predicted, expected = compiled.predict(state, INPUTS), oracle.predict(state, INPUTS)
        for name, left, right in zip(state._fields, predicted, expected, strict=True):
            np.testing.assert_allclose(left, right, rtol=1e-9, atol=1e-12, err_msg=name)
        y = np.array([20 + 0.05 * step + 0.2 * rng.standard_normal()])
        posterior, reference = compiled.update(predicted, y), oracle.update(predicted, y)
        for name, left, right in zip(state._fields, posterior.state, reference.state, strict=True):
            np.testing.assert_allclose(left, right, rtol=1e-9, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(posterior.parameters, reference.parameters, rtol=1e-9)
        assert posterior.log_likelihood == pytest.approx(reference.log_likelihood, rel=1e-9)
        assert posterior.gate == reference.gate
        resampled += posterior.resampled
        state = posterior.state
    assert resampled > 0


def test_an_event_raises_the_volatility_and_closes_the_gate():
    quiet = 20 + 0.15 * np.random.default_rng(0).standard_normal((120, 1))
    event = quiet[-1] + np.array([[0.8], [1.6], [2.4], [3.2], [4.0], [4.8]])
    _, posteriors = filtered({}, np.vstack([quiet, event]))
    calm = [p.alpha_quantiles[0, 1] for p in posteriors[60:119]]
    assert posteriors[-1].alpha_quantiles[0, 1] > 5 * np.median(calm)
    assert posteriors[-1].regime == "high"
    assert posteriors[-1].gate < 0.3


def test_an_impossible_sample_keeps_the_prior_and_is_flagged():
    outputs = np.full((20, 1), 20.0)
    outputs[10] = 1e6
    estimator, posteriors = filtered({}, outputs)
    assert [p.outcome for p in posteriors].count(Outcome.VANISHED) == 1
    assert posteriors[9].outcome is Outcome.VANISHED
    assert np.isnan(posteriors[9].log_likelihood)
    assert posteriors[9].gate == 0.0
    before = estimator.predict(posteriors[8].state, INPUTS)
    for name, left, right in zip(before._fields, before, posteriors[9].state, strict=True):
        np.testing.assert_array_equal(left, right, err_msg=name)
    assert posteriors[-1].outcome is Outcome.ASSIMILATED
    assert abs(float(estimator.predictive(posteriors[-1].state).mean()[0]) - 20.0) < 1.0


def test_no_output_no_learning():
    estimator, posteriors = filtered({}, np.array([[20.0], [20.1], [np.nan]]))
    assert posteriors[1].outcome is Outcome.MISSING
    predicted = estimator.predict(posteriors[0].state, INPUTS)
    for name, left, right in zip(predicted._fields, predicted, posteriors[1].state, strict=True):
        np.testing.assert_array_equal(left, right, err_msg=name)


def test_volatility_blocks_have_their_own_alpha_and_histogram():
    blocks = {"air": ["T_i", "T_h", "T_s"], "mass": ["T_m", "T_e"]}
    outputs = 20 + 0.15 * np.random.default_rng(0).standard_normal((15, 1))
    estimator, posteriors = filtered({"volatility_blocks": blocks}, outputs)
    last = posteriors[-1]
    assert estimator.blocks == ("air", "mass")
    assert last.state.log_alpha.shape == (2, 300)
    assert last.alpha_quantiles.shape == (2, 3)
    assert last.state.histogram.sum(axis=1) == pytest.approx([44, 44])
    assert not np.array_equal(last.state.log_alpha[0], last.state.log_alpha[1])


def test_restart_widens_the_thermal_states_and_keeps_what_was_learned():
    estimator, posteriors = filtered({}, 20 + 0.15 * np.random.default_rng(0).standard_normal((30, 1)))
    old = posteriors[-1].state
    new = estimator.restart(old, np.array([17.0]), INPUTS)
    np.testing.assert_array_equal(new.mean, 17.0)
    np.testing.assert_allclose(new.covariance[0], 0.2**2)
    for name in ("coordinates", "log_alpha", "log_weights", "histogram", "step", "seed"):
        np.testing.assert_array_equal(getattr(new, name), getattr(old, name))


def test_starting_rules():
    rules = {"T_i": InitialTemperature(), "T_m": InitialTemperature("T_out", 1.0), "T_e": InitialTemperature(12.5, 4.0)}
    net = replace(network("building-67"), initial=rules)
    state = build("rbpf", net, PERIOD, {"particles": 50}).start(1, np.array([21.0]), INPUTS)
    np.testing.assert_array_equal(state.mean[:, 0], [21.0, 4.0, 12.5, 21.0, 21.0])
    np.testing.assert_allclose(state.covariance[[0, 2, 5, 9], 0], [4.0, 1.0, 16.0, 9.0])


@pytest.mark.parametrize("implementation", ["compiled", "reference"])
@pytest.mark.parametrize("measured", [("T_i",), ("T_i", "T_e")])
def test_an_issue_of_all_particles_unfolds_to_what_they_do_step_by_step(implementation, measured):
    net = replace(network("building-67"), measured=measured)
    estimator = build("rbpf", net, PERIOD, {"particles": 50, "implementation": implementation})
    state = estimator.start(1, np.full(len(measured), 20.0), INPUTS)
    plan = np.array([[4.0, 8000.0 * (row % 3 == 0), 10.0 * row] for row in range(20)])
    whole = estimator.unfold(estimator.issue(state, 50), plan)
    now, steps = state, [estimator.predictive(state)]
    for ahead, inputs in enumerate(plan, start=1):
        now = estimator._propagate(now, inputs, ahead, Draws(int(state.seed), ahead, forecast=True))
        steps.append(estimator.predictive(now))
    assert len(whole.means) == len(steps) == 21
    for ahead, step in enumerate(steps):
        for of_whole, of_step in zip(whole.at(ahead), step, strict=True):
            np.testing.assert_allclose(of_whole, of_step, rtol=1e-9)
    assert len(estimator.unfold(state, plan[:0]).means) == 1
