"""Augmented-state extended Kalman filter (paper 3.3.1)."""

import math

import numpy as np
from numba import njit

from estimator.arrays import Array
from estimator.gaussian.augmented import AugmentedFilter
from estimator.gaussian.options import AugmentedOptions
from estimator.gaussian.square_root import Gaussian
from estimator.network.modal import ModalNetwork, Tangent
from estimator.network.network import Network


class EKF(AugmentedFilter):
    """The EKF of a zone: (16) linearised at the mean, with exact derivatives.

    Without free parameters it is the Kalman filter.
    """

    mean_is_simulated = True

    def __init__(self, network: Network, period: float, options: AugmentedOptions) -> None:
        super().__init__(network, period, options)
        self._model = ModalNetwork(self.network)
        self._noise = np.repeat([options.process_sd, options.parameter_sd], [self._size, len(self._space.free)])
        self._newest: tuple[bytes, Tangent] | None = None

    def move(self, gaussian: Gaussian, inputs: Array) -> Gaussian:
        """N(s_k) one period on under `inputs` (n_u,)."""
        mean, root = gaussian
        return Gaussian(*_moved(*self._tangent_at(mean[self._size :]), self._noise, inputs, mean, root))

    def _outputs_ahead(self, state: Gaussian, plan: Array) -> tuple[Array, Array]:
        means, variances = np.empty((2, len(plan), len(self._measured)))
        tangent = self._tangent_at(state.mean[self._size :])
        rows = np.ascontiguousarray(plan, dtype=np.float64)
        _followed(*tangent, self._noise, rows, *state, self._prior_sd, self._measured, means, variances)
        return means, variances

    def _tangent_at(self, phi: Array) -> Tangent:
        # Over a forecast phi stays: one linearisation serves all of its steps, in whichever thread.
        known, key = self._newest, phi.tobytes()
        if known is None or known[0] != key:
            theta = self._space.parameters(phi[:, None])[:, 0]
            self._newest = known = key, self._model.linearise(theta, self._space.free, self.period)
        return known[1]


@njit(cache=True, nogil=True)
def _moved(transition, heat, transition_slope, heat_slope, noise, inputs, mean, root):  # type: ignore[no-untyped-def]
    """Mean (n,) and triangular root (n, n) one step on under `inputs`, with `noise` (n,) and a tangent."""
    total = len(mean)
    moved, jacobian = _linearised(transition, heat, transition_slope, heat_slope, inputs, mean)
    rows = np.zeros((2 * total, total))
    for i in range(total):
        for j in range(total):
            for k in range(total):
                rows[i, j] += jacobian[j, k] * root[k, i]
        rows[total + i, i] = noise[i]
    _triangularise(rows, total)
    return moved, np.ascontiguousarray(rows[:total].T)


@njit(cache=True, nogil=True)
def _linearised(transition, heat, transition_slope, heat_slope, inputs, mean):  # type: ignore[no-untyped-def]
    """Mean (n,) one step on under `inputs`, and its derivatives (n, n) by `mean`."""
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
    return moved, jacobian


@njit(cache=True, nogil=True)
def _followed(  # type: ignore[no-untyped-def]
    transition, heat, transition_slope, heat_slope, noise, plan, mean, root, widest, nodes, means, variances
):  # fmt: skip
    """`means` and `variances` (h, n_y) of the states `nodes` after each row of `plan` (h, n_u), as by `predict`: of a
    covariance, which a forecast without measurements cannot spoil, in a fifth of the time."""
    size, total = len(transition), len(mean)
    covariance, product = np.zeros((total, total)), np.empty((size, total))
    for i in range(total):
        for j in range(total):
            for k in range(total):
                covariance[i, j] += root[i, k] * root[j, k]
    for ahead in range(len(plan)):
        mean, jacobian = _linearised(transition, heat, transition_slope, heat_slope, plan[ahead], mean)
        product[:] = 0.0
        for i in range(size):
            for k in range(total):
                for j in range(total):
                    product[i, j] += jacobian[i, k] * covariance[k, j]
        for i in range(size):
            for j in range(i + 1):
                value = 0.0
                for k in range(total):
                    value += product[i, k] * jacobian[j, k]
                covariance[i, j] = covariance[j, i] = value
            for j in range(size, total):
                covariance[i, j] = covariance[j, i] = product[i, j]
        for i in range(total):
            covariance[i, i] += noise[i] * noise[i]
        for i in range(size, total):
            spread = math.sqrt(covariance[i, i])
            if spread > widest[i - size]:
                covariance[i] *= widest[i - size] / spread
                covariance[:, i] *= widest[i - size] / spread
        for y in range(len(nodes)):
            means[ahead, y] = mean[nodes[y]]
            variances[ahead, y] = covariance[nodes[y], nodes[y]]


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
