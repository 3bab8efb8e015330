"""The simulated building: an RC network with known parameters, discretised exactly."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from estimator.arrays import Array
from estimator.network.assembly import assemble, theta_vector
from estimator.network.network import Network


class Dynamics(NamedTuple):
    """x_(k+1) = transition x_k + input u_k + heat f_k over one period; shapes (n_x, n_x), (n_x, n_u) and (n_x, n_x),
    `heat` in K per W into each node."""

    transition: Array
    input: Array
    heat: Array


def dynamics(network: Network, theta: Mapping[str, float], period: float) -> Dynamics:
    """Exact zero-order-hold dynamics (paper (5)-(6)) over `period` s, `theta` by name, else nominal; by a matrix
    exponential, not as the estimators do: simulated data must not share their mistakes."""
    matrices = assemble(network, theta_vector(network, theta))
    capacitance, internal, inputs = matrices.capacitance[0], matrices.internal[0], matrices.inputs[0]
    n_x, n_u = inputs.shape
    generator = np.zeros((2 * n_x + n_u, 2 * n_x + n_u))
    generator[:n_x] = np.hstack([-internal, inputs, np.eye(n_x)]) / capacitance[:, None]
    step = expm(generator * period)[:n_x]
    return Dynamics(step[:, :n_x], step[:, n_x : n_x + n_u], step[:, n_x + n_u :])


def simulate(
    network: Network,
    theta: Mapping[str, float],
    inputs: Array,
    period: float,
    *,
    x0: Array,
    process_noise_sd: float = 0.0,
    unmeasured: Array | None = None,
    rng: np.random.Generator | None = None,
) -> Array:
    """Temperatures (K, n_x) in degC; row k is the state at t_k, row 0 is `x0` (n_x,). Row k of `inputs` (K, n_u), in
    the network's order and units, and of `unmeasured` (K, n_x), in W into each node, hold over [t_k, t_k + period s).
    `process_noise_sd` is in K per node and step (paper (9)); it needs `rng`."""
    step = dynamics(network, theta, period)
    drive = inputs @ step.input.T
    if unmeasured is not None:
        drive += unmeasured @ step.heat.T
    if process_noise_sd > 0.0:
        if rng is None:
            raise ValueError("process noise needs a random generator")
        drive += process_noise_sd * rng.standard_normal(drive.shape)
    states = np.empty_like(drive)
    states[0] = x0
    for k in range(len(states) - 1):
        states[k + 1] = step.transition @ states[k] + drive[k]
    return states
