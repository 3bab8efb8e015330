"""Open-loop simulation of a network (paper (17)) and the exact gradient of what is computed from it.

For fixed theta the network is linear and time-invariant, so its modes are first-order recursive filters, run forward
for the simulation and backward for its adjoint. The gradient by d parameters costs about as much as the simulation.
"""

from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from estimator.arrays import Array, Indices
from estimator.network.assembly import topology
from estimator.network.modal import ModalNetwork
from estimator.network.network import Network


class Gradient(NamedTuple):
    """Of a scalar function of the simulated outputs."""

    log_parameters: Array
    """(d,): by the logarithms of the parameters in question."""
    initial_state: Array
    """(n_x,): by the initial temperatures, per K."""


class Simulation(NamedTuple):
    """States (K, n_x) and outputs (K, n_y) in degC."""

    states: Array
    outputs: Array


def simulate_open_loop(network: Network, theta: Array, initial_state: Array, inputs: Array, period: float) -> Array:
    """Outputs (K, n_y) of `network` with `theta` (n_theta,) from `initial_state` (n_x,), without any correction.

    Row 0 is of the initial state; row k + 1 follows from row k of `inputs` (K, n_u), held over `period` s.
    """
    return OpenLoop(network, period).simulate(theta, initial_state, inputs).outputs


class OpenLoop:
    """The simulation of one network at one sampling period in s."""

    def __init__(self, network: Network, period: float) -> None:
        self._period = period
        self._model = ModalNetwork(network)
        self._measured = topology(network).measured

    def simulate(self, theta: Array, initial_state: Array, inputs: Array) -> Simulation:
        """(17) from `initial_state` (n_x,) under `inputs` (K, n_u), the last of which plays no part."""
        modes = self._model.modes(theta[None])
        drive = (inputs[:-1] @ modes.heat[0].T) * modes.drive(self._period)[0]
        decoupled = _recursions(modes.decay(self._period)[0], modes.inverse[0] @ initial_state, drive)
        states = decoupled @ modes.vectors[0].T
        return Simulation(states, states[:, self._measured])

    def gradient(self, theta: Array, entries: Indices, inputs: Array, states: Array, slope: Array) -> Gradient:
        """Of a function whose derivative by the outputs is `slope` (K, n_y), by the logs of `entries` (d,) of theta.

        `states` (K, n_x) are those simulated with `theta` and `inputs`. With the adjoint l_k = A_d^T l_(k+1) + H^T
        slope_k, the derivative by theta_i is the sum over k of l_(k+1)^T (dA_d/dtheta_i x_k + dB_d/dtheta_i u_k).
        """
        modes, tangent = self._model.modes(theta[None]), self._model.linearise(theta, entries, self._period)
        pushed = np.zeros_like(states)
        pushed[:, self._measured] = slope
        pushed = (pushed @ modes.vectors[0])[::-1]
        adjoint = _recursions(modes.decay(self._period)[0], pushed[0], pushed[1:])[::-1] @ modes.inverse[0]
        by_transition, by_input = adjoint[1:].T @ states[:-1], adjoint[1:].T @ inputs[:-1]
        log_parameters = np.tensordot(tangent.transition_slope, by_transition, 2)
        return Gradient(log_parameters + np.tensordot(tangent.input_slope, by_input, 2), adjoint[0])


def _recursions(decay: Array, start: Array, drive: Array) -> Array:
    """z (K, n) with z_0 = `start` (n,) and z_(k+1) = `decay` z_k + `drive` (K - 1, n)_k, column by column."""
    columns = np.vstack([start, drive])
    for j, factor in enumerate(decay):
        columns[:, j] = lfilter([1.0], [1.0, -factor], columns[:, j])
    return columns
