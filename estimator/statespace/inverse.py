"""The heat that a room needed to be as warm as it was, beside what a learned model knows."""

from collections.abc import Callable

import numpy as np

from estimator.arrays import DAY, Array
from estimator.network.assembly import assemble
from estimator.network.discretise import discretise
from estimator.network.network import Network
from estimator.statespace.matrices import heated
from estimator.types import ModelDraws

Driving = Callable[[Array, Array], Array]
"""`estimator.loop.Loop.driving`."""


def known_heat(draws: ModelDraws, whole: Network, driving: Driving, times: Array, inputs: Array) -> Array:
    """(K, n_u + m): the `inputs` (K, n_u) of the intervals that begin at `times` (K,) [UTC s], those of a missing one
    their mean, and the heat [W] of each term of the models `draws`, of the network `whole` or a variant of it."""
    rows = driving(times, np.where(np.isfinite(inputs), inputs, _mean(inputs)))[:, whole.columns(draws.network)]
    rows[:, len(draws.network.inputs) :] *= [row @ draws.weights for row in draws.coefficients]
    return rows


def missing_heat(draws: ModelDraws, times: Array, step: float, temperature: Array, known: Array) -> Array:
    """(K,): heat [W] into the first measured node with which the mean model of `draws` follows the `temperature` (K,)
    [degC] of that node, NaN where nothing was measured, from each of the intervals of `step` s at `times` [UTC s] to
    the next, under what is `known` (K, n_u + m): inputs, and the heat of its terms [W]."""
    network = draws.network
    exact = discretise(assemble(heated(network), draws.point[:, None]), step)
    room, warms = exact.transition[0], exact.input[0, :, -1]
    size, node = len(room), network.nodes.index(network.measured[0])
    pushes = known @ exact.input[0, :, :-1].T
    # It begins as what stays as it is: at the mean of the first day, with the heat that this needs.
    first = slice(0, max(1, round(DAY / step)))
    still = np.block([[np.eye(size) - room, -warms[:, None]], [np.eye(size + 1)[node]]])
    state = np.linalg.solve(still, np.append(pushes[first].mean(axis=0), _mean(temperature[first])))[:size]
    found = np.zeros(len(times))
    for k, follows in enumerate(np.diff(times) < 1.5 * step):
        state = room @ state + pushes[k]
        missed = temperature[k + 1] - state[node]
        if follows and np.isfinite(missed):
            found[k] = missed / warms[node]
            state = state + warms * found[k]
    return found


def _mean(values: Array) -> Array:
    return np.asarray(np.nansum(values, axis=0) / np.maximum(1, np.isfinite(values).sum(axis=0)))
