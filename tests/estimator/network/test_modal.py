"""Modes and derivatives of the dynamics, against the matrix exponential and finite differences."""

import numpy as np
import pytest
from scipy.linalg import expm

from estimator.network.assembly import assemble
from estimator.network.modal import ModalNetwork
from estimator.network.presets import PRESETS, network

PERIOD = 600.0


def exponential(net, theta):
    """A_d and B_d from the exponential of the augmented matrix, which shares nothing with the modes."""
    matrices = assemble(net, theta[:, None])
    n_x, n_u = matrices.inputs.shape[1:]
    generator = np.zeros((n_x + n_u, n_x + n_u))
    generator[:n_x] = np.hstack([-matrices.internal[0], matrices.inputs[0]]) / matrices.capacitance[0][:, None]
    step = expm(generator * PERIOD)[:n_x]
    return step[:, :n_x], step[:, n_x:]


def drawn(net, seed):
    rng = np.random.default_rng(seed)
    return np.array([rng.uniform(np.log(p.lower), np.log(p.upper)) for p in net.parameters])


@pytest.mark.parametrize("name", PRESETS)
def test_modes_step_as_the_matrix_exponential_does(name):
    net = network(name).validate()
    theta = np.exp([drawn(net, seed) for seed in range(5)])
    rng = np.random.default_rng(1)
    states = 20 + rng.standard_normal((5, len(net.nodes)))
    inputs = 10 * rng.standard_normal(len(net.inputs))
    stepped = ModalNetwork(net).modes(theta).step(states, inputs, PERIOD)
    for values, state, found in zip(theta, states, stepped, strict=True):
        transition, drive = exponential(net, values)
        np.testing.assert_allclose(found, transition @ state + drive @ inputs, rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", PRESETS)
def test_derivatives_match_finite_differences(name, seed):
    net = network(name)
    phi = drawn(net, seed)
    entries = np.arange(len(phi))
    tangent = ModalNetwork(net).linearise(np.exp(phi), entries, PERIOD)
    transition, drive = exponential(net, np.exp(phi))
    np.testing.assert_allclose(tangent.transition, transition, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(tangent.input, drive, rtol=1e-8, atol=1e-12 * np.abs(drive).max())
    step = 1e-4
    for entry in entries:
        sides = []
        for sign in (1, -1):
            moved = phi.copy()
            moved[entry] += sign * step
            sides.append(exponential(net, np.exp(moved)))
        for found, (up, down) in zip(
            (tangent.transition_slope[entry], tangent.input_slope[entry]), zip(*sides, strict=True), strict=True
        ):
            np.testing.assert_allclose(found, (up - down) / (2 * step), rtol=1e-5, atol=1e-7 * (1 + np.abs(up).max()))


def test_derivatives_hold_where_two_modes_decay_alike():
    """Two equal walls on either side of nothing: equal rates, where a divided difference becomes a derivative."""
    net = network("tite").with_parameter("C_i", lower=1e5, nominal=1e6)
    theta = np.array([1e6, 1e6, 1e-3, 150.0])
    found = ModalNetwork(net).linearise(theta, np.array([1, 3]), PERIOD)
    assert np.isfinite(found.transition_slope).all()
    up, down = (exponential(net, theta * np.exp([0, sign * 1e-4, 0, 0]))[0] for sign in (1, -1))
    np.testing.assert_allclose(found.transition_slope[0], (up - down) / 2e-4, atol=1e-8)
