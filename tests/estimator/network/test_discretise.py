"""Exact zero-order hold against SciPy's matrix exponential."""

import numpy as np
import pytest
from scipy.linalg import expm

from estimator.network.assembly import assemble, theta_vector
from estimator.network.discretise import discretise
from estimator.network.presets import PRESETS, network
from estimator.network.space import parameter_space


def random_theta(name, seed, count=20):
    preset = network(name)
    space = parameter_space(preset, logit=True)
    place = np.random.default_rng(seed).random((len(space.free), count))
    return preset, space.parameters(space.from_uniform(place))


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("name", PRESETS)
def test_zoh_equals_the_augmented_matrix_exponential(name, seed):
    preset, theta = random_theta(name, seed)
    matrices, period = assemble(preset, theta), 600.0
    model = discretise(matrices, period)
    n_x, n_u = matrices.inputs.shape[1:]
    for i in range(theta.shape[1]):
        inverse = 1 / matrices.capacitance[i][:, None]
        augmented = np.zeros((n_x + n_u, n_x + n_u))
        augmented[:n_x, :n_x] = -matrices.internal[i] * inverse * period
        augmented[:n_x, n_x:] = matrices.inputs[i] * inverse * period
        exact = expm(augmented)
        np.testing.assert_allclose(model.transition[i], exact[:n_x, :n_x], rtol=1e-8, atol=1e-11)
        scale = np.abs(exact[:n_x, n_x:]).max()
        np.testing.assert_allclose(model.input[i], exact[:n_x, n_x:], rtol=1e-8, atol=1e-10 * scale)


def test_equal_temperatures_without_heat_stay_as_they_are():
    preset, theta = random_theta("building-67", 3)
    model = discretise(assemble(preset, theta), 300.0)
    state = model.transition @ np.full(5, 7.0) + model.input @ np.array([7.0, 0.0, 0.0])
    np.testing.assert_allclose(state, 7.0, rtol=1e-10)


def test_a_long_step_reaches_the_steady_state():
    building = network("building-67")
    matrices = assemble(building, theta_vector(building))
    inputs = np.array([5.0, 800.0, 0.0])
    model = discretise(matrices, 1e9)
    steady = np.linalg.solve(matrices.internal[0], matrices.inputs[0] @ inputs)
    np.testing.assert_allclose(model.input[0] @ inputs, steady, rtol=1e-9)


def test_the_euler_matrix_is_unstable_where_the_exact_one_is_not():
    """Why exact ZOH: the fastest time constant is 95 s and the step 600 s."""
    building = network("building-67")
    matrices = assemble(building, theta_vector(building))
    euler = np.eye(5) - matrices.internal[0] / matrices.capacitance[0][:, None] * 600
    assert np.abs(np.linalg.eigvals(euler)).max() == pytest.approx(5.3, abs=0.1)
    assert np.abs(np.linalg.eigvals(discretise(matrices, 600.0).transition[0])).max() < 1
