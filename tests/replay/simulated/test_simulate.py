import numpy as np
from scipy.integrate import solve_ivp

from estimator.network.assembly import assemble, theta_vector
from estimator.network.presets import PRESETS
from replay.simulated.simulate import dynamics, simulate

TITE_THETA = {"C_i": 2e6, "C_e": 2e7, "g_ie": 500.0, "g_e_out": 150.0}


def test_one_step_agrees_with_a_numerical_integration() -> None:
    network, inputs = PRESETS["ecolar-6r4c"], np.array([[5.0, 12.0, 1500.0], [0.0, 0.0, 0.0]])
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


def test_process_noise_has_the_stated_size_and_comes_from_the_generator() -> None:
    def run(seed: int) -> np.ndarray:
        rng = np.random.default_rng(seed)
        inputs = np.zeros((4000, 2))
        return simulate(PRESETS["tite"], TITE_THETA, inputs, 600.0, x0=np.zeros(2), process_noise_sd=0.03, rng=rng)

    states = run(1)
    np.testing.assert_array_equal(states, run(1))
    shocks = states[1:] - states[:-1] @ dynamics(PRESETS["tite"], TITE_THETA, 600.0).transition.T
    # 5 standard errors of a standard deviation from 4000 draws
    assert np.allclose(shocks.std(axis=0), 0.03, atol=5 * 0.03 / np.sqrt(2 * 4000))
