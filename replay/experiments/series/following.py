"""What a network with frozen parameters says of a recording, led by its measurements."""

import numpy as np
from scipy.linalg import solve_discrete_are

from estimator.arrays import Array
from estimator.network.assembly import assemble, topology
from estimator.network.discretise import discretise
from estimator.network.network import Network
from estimator.network.starting import initial_temperatures

STATE_NOISE_SD, MEASUREMENT_SD = 0.03, 0.1
"""K per step, and K, of the filter that prepares a window."""


def follow(network: Network, theta: Array, period: float, outputs: Array, inputs: Array) -> Array:
    """States (K, n_x) [degC] after each of K `outputs` (K, n_y), the first of which is there, under `inputs` (K, n_u),
    by a steady-state Kalman filter with `theta` (n_theta,). Windows of open-loop simulation start from them (paper
    4.3.3: "re-initialised at the first sample", which leaves the hidden nodes open)."""
    model, places = discretise(assemble(network, theta[:, None]), period), topology(network).measured
    transition, into = model.transition[0], model.input[0]
    observed, noise = np.eye(len(transition))[places], MEASUREMENT_SD**2 * np.eye(outputs.shape[1])
    spread = solve_discrete_are(transition.T, observed.T, STATE_NOISE_SD**2 * np.eye(len(transition)), noise)
    gain = np.linalg.solve(observed @ spread @ observed.T + noise, observed @ spread).T
    state = initial_temperatures(network, outputs[0], inputs[0])[0]
    states = np.empty((len(outputs), len(state)))
    for k, output in enumerate(outputs):
        state = transition @ state + into @ inputs[k - 1] if k else state
        error = output - state[places]
        states[k] = state = state + gain @ np.where(np.isnan(error), 0.0, error)
    return states


def frozen(network: Network, theta: Array) -> Network:
    """`network` held at `theta` (n_theta,): what is left to fit are the temperatures it starts from."""
    for parameter, value in zip(network.parameters, theta, strict=True):
        network = network.with_parameter(parameter.name, nominal=float(value), free=False)
    return network
