import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estimator.network.assembly import assemble, theta_vector
from estimator.network.presets import building_67, ecolar, tite
from replay.simulated.simulate import dynamics, simulate

TITE_THETA = {"C_i": 2e6, "C_e": 2e7, "g_ie": 500.0, "g_e_out": 150.0}


def test_one_step_agrees_with_a_numerical_integration() -> None:
    network, inputs = ecolar(), np.array([[5.0, 12.0, 1500.0], [0.0, 0.0, 0.0]])
    unmeasured = np.array([[300.0, 0.0, -40.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    start = np.array([21.0, 18.0, 20.0, 40.0])
    after = simulate(network, {}, inputs, 300.0, x0=start, unmeasured=unmeasured)[1]

    matrices = assemble(network, theta_vector(network))
    heat = matrices.inputs[0] @ inputs[0] + unmeasured[0]
    integrated = solve_ivp(
        lambda _, x: (heat - matrices.internal[0] @ x) / matrices.capacitance[0],
        (0.0, 300.0),
        start,
        method="Radau",
        rtol=1e-10,
        atol=1e-10,
    )
    np.testing.assert_allclose(after, integrated.y[:, -1], rtol=1e-7)


def test_holding_the_input_for_two_steps_is_one_step_of_twice_the_period() -> None:
    inputs = np.tile([3.0, 800.0, 200.0], (5, 1))
    start = np.full(5, 20.0)
    fine = simulate(building_67(), {}, inputs, 300.0, x0=start)
    coarse = simulate(building_67(), {}, inputs[:3], 600.0, x0=start)
    np.testing.assert_allclose(fine[::2], coarse, rtol=1e-12)


def test_settles_at_the_steady_state_of_the_network() -> None:
    inputs = np.tile([-5.0, 1500.0], (20_000, 1))
    settled = simulate(tite(), TITE_THETA, inputs, 600.0, x0=np.array([0.0, 0.0]))[-1]
    envelope = -5.0 + 1500.0 / 150.0
    np.testing.assert_allclose(settled, [envelope + 1500.0 / 500.0, envelope], rtol=1e-9)


def test_input_of_step_k_acts_first_on_state_k_plus_one() -> None:
    inputs = np.zeros((4, 2))
    inputs[1, 1] = 5000.0
    states = simulate(tite(), TITE_THETA, inputs, 600.0, x0=np.zeros(2))
    assert (states[:2] == 0).all()
    assert states[2, 0] > 1.0


def test_watts_into_a_node_heat_like_the_heater_at_that_node() -> None:
    step = dynamics(tite(), TITE_THETA, 600.0)
    np.testing.assert_allclose(step.heat[:, 0], step.input[:, 1], rtol=1e-12)


def test_process_noise_has_the_stated_size_and_comes_from_the_generator() -> None:
    def run(seed: int) -> np.ndarray:
        rng = np.random.default_rng(seed)
        inputs = np.zeros((4000, 2))
        return simulate(tite(), TITE_THETA, inputs, 600.0, x0=np.zeros(2), process_noise_sd=0.03, rng=rng)

    states = run(1)
    np.testing.assert_array_equal(states, run(1))
    shocks = states[1:] - states[:-1] @ dynamics(tite(), TITE_THETA, 600.0).transition.T
    # 5 standard errors of a standard deviation from 4000 draws
    assert np.allclose(shocks.std(axis=0), 0.03, atol=5 * 0.03 / np.sqrt(2 * 4000))


def test_process_noise_without_a_generator_is_refused() -> None:
    with pytest.raises(ValueError, match="random generator"):
        simulate(tite(), TITE_THETA, np.zeros((2, 2)), 600.0, x0=np.zeros(2), process_noise_sd=0.1)
