"""Augmented-state extended Kalman filter (paper 3.3.1)."""

from __future__ import annotations

import numpy as np

from estimator.arrays import Array
from estimator.gaussian.augmented import AugmentedFilter, Move
from estimator.gaussian.options import AugmentedOptions
from estimator.gaussian.square_root import Gaussian, triangular_root
from estimator.network.modal import ModalNetwork, Tangent
from estimator.network.network import Network
from estimator.network.space import parameter_space


def ekf(network: Network, period: float, options: AugmentedOptions) -> AugmentedFilter:
    """The EKF of a zone. Without free parameters it is the Kalman filter."""
    network = network.validate()
    return AugmentedFilter(network, period, options, _move(network, period, options), mean_is_simulated=True)


def _move(network: Network, period: float, options: AugmentedOptions) -> Move:
    """(16) linearised at the mean, with exact derivatives."""
    model, space = ModalNetwork(network), parameter_space(network, logit=False)
    size, total = len(network.nodes), len(network.nodes) + len(space.free)
    noise = np.diag(np.repeat([options.process_sd, options.parameter_sd], [size, total - size]))

    newest: tuple[bytes, Tangent] | None = None

    def tangent_at(phi: Array) -> Tangent:
        # Over a forecast phi stays: one linearisation serves all of its steps, in whichever thread.
        nonlocal newest
        known, key = newest, phi.tobytes()
        if known is None or known[0] != key:
            newest = known = key, model.linearise(space.parameters(phi[:, None])[:, 0], space.free, period)
        return known[1]

    def move(gaussian: Gaussian, inputs: Array) -> Gaussian:
        mean, root = gaussian
        temperatures, tangent = mean[:size], tangent_at(mean[size:])
        jacobian = np.eye(total)
        jacobian[:size, :size] = tangent.transition
        jacobian[:size, size:] = (tangent.transition_slope @ temperatures + tangent.input_slope @ inputs).T
        moved = np.concatenate([tangent.transition @ temperatures + tangent.input @ inputs, mean[size:]])
        return Gaussian(moved, triangular_root(np.vstack([(jacobian @ root).T, noise])))

    return move
