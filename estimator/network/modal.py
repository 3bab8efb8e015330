"""A network's dynamics in its modes: exact zero-order hold (paper (5)-(6)) and its derivative by log theta.

With C^(-1/2) G C^(-1/2) = V diag(rate) V^T and W = C^(-1/2) V, the modes z = W^T C x decouple: each decays with its
rate and is driven by W^T B_u u. The derivative of the matrix exponential is exact too: in modes, the Frechet derivative
of exp in direction K is K times, element by element, the divided differences of exp at the rates (Daleckii and Krein).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from estimator.arrays import Array, Indices
from estimator.network.assembly import assemble, topology
from estimator.network.network import Network

_EPSILON = float(np.finfo(float).eps)


class Modes(NamedTuple):
    """The dynamics of N parameter vectors, decoupled."""

    rate: Array
    """(N, n_x) in 1/s, slowest first."""
    vectors: Array
    """(N, n_x, n_x): W; x = W z."""
    inverse: Array
    """(N, n_x, n_x): W^T C; z = W^T C x."""
    heat: Array
    """(N, n_x, n_u): W^T B_u, what a unit of each input does to each mode."""

    def decay(self, period: float) -> Array:
        """(N, n_x): what is left of each mode after `period` s."""
        return np.exp(-self.rate * period)

    def drive(self, period: float) -> Array:
        """(N, n_x): a mode after `period` s of a unit of heat held, from zero."""
        return np.asarray(-np.expm1(-self.rate * period) / self.rate, dtype=np.float64)

    def step(self, states: Array, inputs: Array, period: float) -> Array:
        """States (N, n_x) one `period` on from `states` (N, n_x), under `inputs` (n_u,) held."""
        modes = (self.inverse @ states[:, :, None])[:, :, 0]
        later = self.decay(period) * modes + self.drive(period) * (self.heat @ inputs)
        return (self.vectors @ later[:, :, None])[:, :, 0]


class Tangent(NamedTuple):
    """A_d and B_d of one parameter vector, and their derivatives by the logarithms of d of its entries."""

    transition: Array
    """(n_x, n_x): A_d."""
    input: Array
    """(n_x, n_u): B_d."""
    transition_slope: Array
    """(d, n_x, n_x): dA_d / d log theta_i."""
    input_slope: Array
    """(d, n_x, n_u): dB_d / d log theta_i."""


class ModalNetwork:
    """C, G_int and B_u as linear functions of theta (paper (1)-(4)), for fast modes and derivatives."""

    def __init__(self, network: Network) -> None:
        count = len(network.parameters)
        unit = assemble(network, np.eye(count))
        constant = assemble(network, np.zeros((count, 1))).inputs[0]
        self._capacitance = topology(network).capacitance
        self._node = (self._capacitance == np.arange(count)[:, None]).astype(np.float64)
        self._internal = unit.internal
        self._constant = constant
        self._inputs = unit.inputs - constant

    def modes(self, theta: Array) -> Modes:
        """Modes of `theta` (N, n_theta)."""
        root = np.sqrt(theta[:, self._capacitance])
        internal = np.tensordot(theta, self._internal, 1)
        rate, vectors = np.linalg.eigh(internal / (root[:, :, None] * root[:, None, :]))
        # Rounding may make the rate of an all but perfectly insulated mode negative.
        rate = np.maximum(rate, rate[:, -1:] * _EPSILON)
        shapes = vectors / root[:, :, None]
        heat = shapes.transpose(0, 2, 1) @ (self._constant + np.tensordot(theta, self._inputs, 1))
        return Modes(rate, shapes, vectors.transpose(0, 2, 1) * root[:, None, :], heat)

    def linearise(self, theta: Array, entries: Indices, period: float) -> Tangent:
        """A_d and B_d over `period` s at `theta` (n_theta,), with derivatives by the logs of its `entries` (d,)."""
        known = self._capacitance, self._node, self._internal, self._constant, self._inputs
        return Tangent(*_linearised(np.asarray(theta, dtype=np.float64), entries, float(period), *known))


@njit(cache=True, nogil=True)
def _linearised(theta, entries, period, capacitance, node, internal, constant, inputs):  # type: ignore[no-untyped-def]
    """The arrays of a `Tangent`. The modes are those of `ModalNetwork.modes`, of one parameter vector."""
    n, whole, driven = len(capacitance), np.zeros(internal.shape[1:]), constant.copy()
    for p in range(len(theta)):
        whole += theta[p] * internal[p]
        driven += theta[p] * inputs[p]
    root = np.sqrt(theta[capacitance])
    for i in range(n):
        for j in range(n):
            whole[i, j] /= root[i] * root[j]
    rate, vectors = np.linalg.eigh(whole)
    rate = np.maximum(rate, rate[-1] * _EPSILON)
    shapes, across, inverse, decaying = np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    for i in range(n):
        for j in range(n):
            shapes[i, j] = across[j, i] = vectors[i, j] / root[i]
            inverse[j, i] = vectors[i, j] * root[i]
            decaying[i, j] = shapes[i, j] * math.exp(-rate[j] * period)
    transition = _product(decaying, inverse)
    remainder = -transition
    for i in range(n):
        remainder[i, i] += 1.0
    steady = _steady(shapes, across, rate, driven)
    differences = _divided_differences(rate, period)
    slope, input_slope = np.empty((len(entries), n, n)), np.empty((len(entries), n, steady.shape[1]))
    for d in range(len(entries)):
        p = entries[d]
        scaled = theta[p] * internal[p]
        direction = _product(_product(inverse, np.diag(node[p])), shapes)
        leaving = _product(_product(across, scaled), shapes)
        for i in range(n):
            for j in range(n):
                direction[i, j] = differences[i, j] * (direction[i, j] * rate[j] - leaving[i, j])
        turned = _product(_product(shapes, direction), inverse)
        # B_d = (I - A_d) G^(-1) B_u spares the derivative of the input integral.
        steady_slope = _steady(shapes, across, rate, theta[p] * inputs[p] - _product(scaled, steady))
        driving, lost = _product(remainder, steady_slope), _product(turned, steady)
        for i in range(n):
            for j in range(n):
                slope[d, i, j] = turned[i, j]
            for j in range(steady.shape[1]):
                input_slope[d, i, j] = driving[i, j] - lost[i, j]
    return transition, _product(remainder, steady), slope, input_slope


@njit(cache=True, nogil=True)
def _steady(shapes, across, rate, forcing):  # type: ignore[no-untyped-def]
    """(n_x, m): G^(-1) F, where the nodes come to rest under `forcing` F (n_x, m)."""
    modes = _product(across, forcing)
    for i in range(len(rate)):
        for j in range(modes.shape[1]):
            modes[i, j] /= rate[i]
    return _product(shapes, modes)


@njit(cache=True, nogil=True)
def _product(left, right):  # type: ignore[no-untyped-def]
    """A matrix product. For a few nodes loops are as fast as a library, and compile in a fraction of the time, as do
    single elements in place of rows."""
    found = np.zeros((left.shape[0], right.shape[1]))
    for i in range(left.shape[0]):
        for k in range(left.shape[1]):
            for j in range(right.shape[1]):
                found[i, j] += left[i, k] * right[k, j]
    return found


@njit(cache=True, nogil=True)
def _divided_differences(rate, period):  # type: ignore[no-untyped-def]
    """(n_x, n_x): (exp(-r_i t) - exp(-r_j t)) / (r_j - r_i) for rates (n_x,), t exp(-r_i t) where they are equal."""
    found = np.empty((len(rate), len(rate)))
    for i in range(len(rate)):
        for j in range(len(rate)):
            apart = abs(rate[i] - rate[j]) * period
            ratio = -math.expm1(-apart) / apart if apart > 0.0 else 1.0
            found[i, j] = period * math.exp(-min(rate[i], rate[j]) * period) * ratio
    return found
