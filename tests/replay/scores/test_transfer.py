import numpy as np

from estimator.network.assembly import assemble
from estimator.network.discretise import discretise
from estimator.network.network import Conductance, Gain, HeatInput, Network, Parameter
from estimator.network.presets import PRESETS
from replay.scores.transfer import frequency_response, transfer_errors

PERIOD = 600.0


def one_node(capacitance: float, conductance: float) -> Network:
    return Network(
        name="one",
        capacitances={"T_i": "C_i"},
        boundaries=("T_out",),
        conductances=(Conductance("g", ("T_i", "T_out")),),
        heat_inputs=(HeatInput("u_heat", "T_i"), HeatInput("I_sol", "T_i", Gain(parameter="A_w"), "W/m2")),
        parameters=(
            Parameter("C_i", "J/K", 1e4, 1e8, capacitance),
            Parameter("g", "W/K", 1.0, 1e4, conductance),
            Parameter("A_w", "m2", 0.1, 10.0, 2.0),
        ),
        measured=("T_i",),
    ).validate()


def test_one_node_has_the_response_of_a_first_order_lag() -> None:
    capacitance, conductance = 2e6, 150.0
    found = frequency_response(
        one_node(capacitance, conductance), np.array([[capacitance], [conductance], [2.0]]), PERIOD
    )
    pole = np.exp(-conductance * PERIOD / capacitance)
    omega = np.pi * np.arange(512) / 511
    lag = (1 - pole) / (np.exp(1j * omega) - pole)
    assert found.shape == (1, 512, 1, 3)
    np.testing.assert_allclose(found[0, :, 0], np.stack([lag, lag / conductance, 2 * lag / conductance], 1), rtol=1e-12)


def test_response_is_the_fourier_transform_of_the_impulse_response() -> None:
    network = PRESETS["building-67"]
    # Light nodes and strong links so that the impulse response has died away after the samples taken here.
    fast = {"C_i": 4e6, "C_m": 9e6, "C_e": 5e6, "C_h": 2e5, "C_s": 3e5, "g_e_out": 420.0}
    theta = np.array([fast.get(p.name, p.nominal) for p in network.parameters], dtype=float)[:, None]
    model = discretise(assemble(network, theta), PERIOD)
    state, impulse = model.input[0], []
    for _ in range(6000):
        impulse.append(state[0])
        state = model.transition[0] @ state
    omega = np.array([0.0, 0.4, np.pi])
    # G(z) = sum over k of h_k z^-(k+1)
    expected = np.exp(-1j * np.outer(omega, np.arange(1, 6001))) @ np.array(impulse)
    grid = frequency_response(network, theta, PERIOD, points=512)[0, :, 0]
    np.testing.assert_allclose(grid[[0, 511]], expected[[0, 2]], rtol=1e-9)
    near = np.pi * np.arange(512) / 511
    assert near[65] < 0.4 < near[66]
    low, high = np.abs(grid[66]), np.abs(grid[65])
    assert ((low <= np.abs(expected[1])) & (np.abs(expected[1]) <= high)).all()


def test_a_gain_that_is_ten_percent_off_is_an_error_of_a_tenth_in_its_channel_alone() -> None:
    network = one_node(2e6, 150.0)
    errors = transfer_errors(network, np.array([[2e6], [150.0], [2.2]]), np.array([2e6, 150.0, 2.0]), PERIOD)
    np.testing.assert_allclose(errors.h2, [[[0.0, 0.0, 0.1]]], atol=1e-12)
    np.testing.assert_allclose(errors.h_infinity, [[[0.0, 0.0, 0.1]]], atol=1e-12)
