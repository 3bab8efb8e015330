"""Open-loop simulation against the testbed's, and its gradient against finite differences."""

import numpy as np
import pytest

from estimator.network.presets import PRESETS, network
from estimator.offline.open_loop import OpenLoop, simulate_open_loop
from replay.simulated.simulate import simulate

PERIOD = 600.0


def case(name, seed, steps=40):
    net, rng = network(name), np.random.default_rng(seed)
    phi = np.array([rng.uniform(np.log(p.lower), np.log(p.upper)) for p in net.parameters])
    state = 20 + rng.standard_normal(len(net.nodes))
    inputs = np.column_stack([rng.uniform(0, 30 if "T_" in channel else 500, steps) for channel in net.inputs])
    return net, phi, state, inputs


@pytest.mark.parametrize("name", PRESETS)
def test_it_simulates_as_the_testbed_does(name):
    net, phi, state, inputs = case(name, 1)
    theta = {p.name: value for p, value in zip(net.parameters, np.exp(phi), strict=True)}
    expected = simulate(net, theta, inputs, PERIOD, x0=state)
    np.testing.assert_allclose(simulate_open_loop(net, np.exp(phi), state, inputs, PERIOD), expected[:, :1], rtol=1e-8)


def test_the_last_inputs_play_no_part():
    net, phi, state, inputs = case("titeth", 1)
    changed = inputs.copy()
    changed[-1] = 1e6
    left, right = (simulate_open_loop(net, np.exp(phi), state, rows, PERIOD) for rows in (inputs, changed))
    np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", PRESETS)
def test_gradients_match_finite_differences(name, seed):
    net, phi, state, inputs = case(name, seed)
    loop, entries = OpenLoop(net, PERIOD), np.arange(len(phi))
    target = np.random.default_rng(5).uniform(15, 25, (len(inputs), 1))

    def value(phi, state):
        return float(((loop.simulate(np.exp(phi), state, inputs).outputs - target) ** 2).sum())

    simulation = loop.simulate(np.exp(phi), state, inputs)
    found = loop.gradient(np.exp(phi), entries, inputs, simulation.states, 2 * (simulation.outputs - target))
    step = 3e-4
    for i, expected in enumerate(found.log_parameters):
        move = step * (entries == i)
        numeric = (value(phi + move, state) - value(phi - move, state)) / (2 * step)
        assert numeric == pytest.approx(expected, rel=1e-4, abs=1e-5 * np.abs(found.log_parameters).max())
    for i, expected in enumerate(found.initial_state):
        move = 0.1 * (np.arange(len(state)) == i)
        numeric = (value(phi, state + move) - value(phi, state - move)) / 0.2
        assert numeric == pytest.approx(expected, rel=1e-5, abs=1e-6 * np.abs(found.initial_state).max())
