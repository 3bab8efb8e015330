"""A simulated two-mass building without disturbances, and a Kalman filter straight from a textbook."""

from typing import NamedTuple

import numpy as np

from estimator.network.network import Conductance, HeatInput, Network, Parameter
from estimator.network.presets import network
from replay.simulated.simulate import dynamics, simulate

PERIOD = 600.0
TRUTH = {"C_i": 4e6, "C_e": 3e7, "g_ie": 400.0, "g_e_out": 180.0}


class Record(NamedTuple):
    """inputs (K, n_u), outputs (K, n_y) with noise, states (K, n_x)."""

    inputs: np.ndarray
    outputs: np.ndarray
    states: np.ndarray


def building() -> Network:
    """`tite` with boxes of .1 to 3 times the truth, so that their middle is not the truth."""
    net = network("tite")
    for name, value in TRUTH.items():
        net = net.with_parameter(name, lower=0.1 * value, upper=3 * value, nominal=value)
    return net


def record(steps: int, seed: int, process_sd: float = 0.0, noise_sd: float = 0.05) -> Record:
    """A winter week or more with a heater that switches at random."""
    rng = np.random.default_rng(seed)
    hours = np.arange(steps) * PERIOD / 3600
    heat = 4000.0 * np.repeat(rng.integers(0, 2, steps // 12 + 1), 12)[:steps]
    inputs = np.column_stack([5 + 4 * np.sin(2 * np.pi * hours / 24), heat])
    states = simulate(
        building(), TRUTH, inputs, PERIOD, x0=np.array([20.0, 17.0]), process_noise_sd=process_sd, rng=rng
    )
    return Record(inputs, states[:, :1] + noise_sd * rng.standard_normal((steps, 1)), states)


def after(estimator, inputs, outputs, seed=4):
    """What an estimator knows after `outputs` (K, n_y) under `inputs` (K, n_u)."""
    state = estimator.start(seed, outputs[0], inputs[0])
    for u, y in zip(inputs[:-1], outputs[1:], strict=True):
        state = estimator.update(estimator.predict(state, u), y).state
    return state


def textbook_kalman(net, theta, period, start, record, process_sd, noise_sd, measured):
    """Predicted means and sds (K - 1, n_y) and the log likelihood; `start` is (mean, covariance) at sample 0."""
    step = dynamics(net, theta, period)
    mean, covariance = start
    observe = np.eye(len(mean))[measured]
    noise, error = process_sd**2 * np.eye(len(mean)), noise_sd**2 * np.eye(len(measured))
    means, sds, total = [], [], 0.0
    for u, y in zip(record.inputs[:-1], record.outputs[1:], strict=True):
        mean = step.transition @ mean + step.input @ u
        covariance = step.transition @ covariance @ step.transition.T + noise
        spread = observe @ covariance @ observe.T + error
        means.append(observe @ mean)
        sds.append(np.sqrt(np.diag(spread)))
        seen = ~np.isnan(y)
        rows, spread, innovation = observe[seen], spread[np.ix_(seen, seen)], (y - observe @ mean)[seen]
        total -= 0.5 * (innovation @ np.linalg.solve(spread, innovation) + np.log(np.linalg.det(2 * np.pi * spread)))
        gain = covariance @ rows.T @ np.linalg.inv(spread)
        mean = mean + gain @ innovation
        covariance = covariance - gain @ rows @ covariance
    return np.array(means), np.array(sds), total


def known(net: Network) -> Network:
    """`net` with every parameter held at its nominal value."""
    return net.with_fixed(p.name for p in net.parameters)


DAY = 48
"""Steps of `room`."""


def room(count, seed=1):
    """A room of one capacity under random heating, and its inputs, every half hour."""
    rng = np.random.default_rng(seed)
    inputs = np.column_stack([5 + 3 * np.sin(2 * np.pi * np.arange(count) / DAY), 1000.0 * (rng.random(count) < 0.3)])
    outputs = np.full(count, 20.0)
    for k in range(count - 1):
        outputs[k + 1] = 0.97 * outputs[k] + 0.03 * inputs[k, 0] + 0.0015 * inputs[k, 1] + 0.02 * rng.standard_normal()
    return outputs, inputs


def two_rooms() -> Network:
    """Two measured rooms with a wall between them, one of them heated by a share of the heater that is to be found."""
    return Network(
        name="two-rooms",
        capacitances={"T_a": "C_a", "T_b": "C_b"},
        boundaries=("T_out",),
        conductances=(
            Conductance("g_ab", ("T_a", "T_b")),
            Conductance("g_a_out", ("T_a", "T_out")),
            Conductance("g_b_out", ("T_b", "T_out")),
        ),
        heat_inputs=(HeatInput("u_a", "T_a"), HeatInput("u_b", "T_b")),
        parameters=(
            Parameter("C_a", "J/K", 1e6, 1e8),
            Parameter("C_b", "J/K", 1e6, 1e8),
            Parameter("g_ab", "W/K", 10.0, 1e3),
            Parameter("g_a_out", "W/K", 10.0, 1e3),
            Parameter("g_b_out", "W/K", 100.0, 200.0, nominal=150.0, free=False),
        ),
        measured=("T_b", "T_a"),
    ).validate()
