"""A network's dynamics in its modes: exact zero-order hold (paper (5)-(6)) and its derivative by log theta.

With C^(-1/2) G C^(-1/2) = V diag(rate) V^T and W = C^(-1/2) V, the modes z = W^T C x decouple: each decays with its
rate and is driven by W^T B_u u. The derivative of the matrix exponential is exact too: in modes, the Frechet derivative
of exp in direction K is K times, element by element, the divided differences of exp at the rates (Daleckii and Krein).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array, Indices
from estimator.network.assembly import assemble, topology
from estimator.network.network import Network


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
        rate = np.maximum(rate, rate[:, -1:] * np.finfo(float).eps)
        shapes = vectors / root[:, :, None]
        heat = shapes.transpose(0, 2, 1) @ (self._constant + np.tensordot(theta, self._inputs, 1))
        return Modes(rate, shapes, vectors.transpose(0, 2, 1) * root[:, None, :], heat)

    def linearise(self, theta: Array, entries: Indices, period: float) -> Tangent:
        """A_d and B_d over `period` s at `theta` (n_theta,), with derivatives by the logs of its `entries` (d,)."""
        (rate,), (shapes,), (inverse,), (heat,) = self.modes(theta[None])
        decay = np.exp(-rate * period)
        transition = (shapes * decay) @ inverse
        remainder = np.eye(len(rate)) - transition
        steady = shapes @ (heat / rate[:, None])

        scaled = theta[entries, None, None] * self._internal[entries]
        capacity = inverse * self._node[entries, None, :]
        direction = capacity @ shapes * rate - shapes.T @ scaled @ shapes
        slope = shapes @ (_divided_differences(rate, period) * direction) @ inverse
        # B_d = (I - A_d) G^(-1) B_u spares the derivative of the input integral.
        forcing = theta[entries, None, None] * self._inputs[entries] - scaled @ steady
        steady_slope = shapes @ ((shapes.T @ forcing) / rate[:, None])
        return Tangent(transition, remainder @ steady, slope, remainder @ steady_slope - slope @ steady)


def _divided_differences(rate: Array, period: float) -> Array:
    """(n_x, n_x): (exp(-r_i t) - exp(-r_j t)) / (r_j - r_i) for rates (n_x,), t exp(-r_i t) where they are equal."""
    apart = np.abs(rate[:, None] - rate[None, :]) * period
    slow = np.minimum(rate[:, None], rate[None, :])
    ratio = np.divide(-np.expm1(-apart), apart, out=np.ones_like(apart), where=apart > 0)
    return np.asarray(period * np.exp(-slow * period) * ratio, dtype=np.float64)
