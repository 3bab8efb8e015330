"""Augmented-state extended Kalman filter (paper 3.3.1)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from estimator.arrays import Array
from estimator.gaussian.augmented import AugmentedFilter, Move
from estimator.gaussian.options import AugmentedOptions
from estimator.gaussian.square_root import Gaussian
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
    size = len(network.nodes)
    noise = np.repeat([options.process_sd, options.parameter_sd], [size, len(space.free)])

    newest: tuple[bytes, Tangent] | None = None

    def tangent_at(phi: Array) -> Tangent:
        # Over a forecast phi stays: one linearisation serves all of its steps, in whichever thread.
        nonlocal newest
        known, key = newest, phi.tobytes()
        if known is None or known[0] != key:
            tangent = model.linearise(space.parameters(phi[:, None])[:, 0], space.free, period)
            newest = known = key, Tangent(*(np.ascontiguousarray(matrix) for matrix in tangent))
        return known[1]

    def move(gaussian: Gaussian, inputs: Array) -> Gaussian:
        mean, root = gaussian
        return Gaussian(*_moved(*tangent_at(mean[size:]), noise, inputs, mean, root))

    return move


@njit(cache=True, nogil=True)
def _moved(transition, heat, transition_slope, heat_slope, noise, inputs, mean, root):  # type: ignore[no-untyped-def]
    """Mean (n,) and triangular root (n, n) one step on under `inputs`, with `noise` (n,) and a tangent."""
    size, total = len(transition), len(mean)
    moved = mean.copy()
    jacobian = np.eye(total)
    for i in range(size):
        moved[i] = 0.0
        for j in range(size):
            moved[i] += transition[i, j] * mean[j]
            jacobian[i, j] = transition[i, j]
        for j in range(len(inputs)):
            moved[i] += heat[i, j] * inputs[j]
        for d in range(total - size):
            slope = 0.0
            for j in range(size):
                slope += transition_slope[d, i, j] * mean[j]
            for j in range(len(inputs)):
                slope += heat_slope[d, i, j] * inputs[j]
            jacobian[i, size + d] = slope
    rows = np.zeros((2 * total, total))
    for i in range(total):
        for j in range(total):
            for k in range(total):
                rows[i, j] += jacobian[j, k] * root[k, i]
        rows[total + i, i] = noise[i]
    _triangularise(rows, total)
    return moved, np.ascontiguousarray(rows[:total].T)


@njit(cache=True, nogil=True)
def _triangularise(rows, n):  # type: ignore[no-untyped-def]
    """Householder: `rows` (2n, n), the lower half of which is diagonal, become an upper triangle above zeros."""
    for k in range(n):
        # Below the diagonal only the rows up to k have been filled.
        last = n + k + 1
        norm = 0.0
        for i in range(k, last):
            norm += rows[i, k] * rows[i, k]
        norm = math.sqrt(norm)
        if norm > 0.0:
            pivot = rows[k, k] + math.copysign(norm, rows[k, k])
            end = -math.copysign(norm, rows[k, k])
            scale = abs(pivot) * norm
            rows[k, k] = pivot
            for j in range(k + 1, n):
                share = 0.0
                for i in range(k, last):
                    share += rows[i, k] * rows[i, j]
                share /= scale
                for i in range(k, last):
                    rows[i, j] -= share * rows[i, k]
            for i in range(k, last):
                rows[i, k] = 0.0
            rows[k, k] = end
