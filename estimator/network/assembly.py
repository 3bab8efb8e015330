"""From a network to its matrices (paper 3.1, equations (1)-(4)).

`topology` turns the names of a network into index arrays, so that one compiled kernel serves every network; `assemble`
is the textbook construction of C, G_int and B_u from them.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array, Indices
from estimator.network.network import Network


class Topology(NamedTuple):
    """A network as indices into x (n_x), u (n_u) and theta (n_theta)."""

    capacitance: Indices
    """(n_x,): entry of theta that is each node's capacitance."""
    edges: Indices
    """(n_edges, 3): state node, other node (boundary b counts as n_x + b), entry of theta."""
    heat: Indices
    """(n_heat, 3): state node, input, entry of theta (0 where the gain has no parameter)."""
    heat_gain: Array
    """(n_heat, 2): constant part of the gain, factor on its parameter (0 where it has none)."""
    measured: Indices
    """(n_y,): measured state nodes; the rows of H."""


@lru_cache(maxsize=1024)
def topology(network: Network) -> Topology:
    """Index arrays of a validated network, which are not to be changed."""
    theta = {parameter.name: index for index, parameter in enumerate(network.parameters)}
    node = {name: index for index, name in enumerate((*network.nodes, *network.boundaries))}
    column = {name: index for index, name in enumerate(network.inputs)}
    edges = [
        [*sorted((node[a], node[b])), theta[edge.name]] for edge in network.conductances for a, b in [edge.between]
    ]
    heat = [
        (node[heat.node], column[heat.channel], theta[heat.gain.parameter] if heat.gain.parameter else 0)
        for heat in network.heat_inputs
    ]
    gain = [(heat.gain.constant, heat.gain.sign if heat.gain.parameter else 0.0) for heat in network.heat_inputs]
    return Topology(
        capacitance=np.array([theta[name] for name in network.capacitances.values()], dtype=np.int64),
        edges=np.array(edges, dtype=np.int64).reshape(-1, 3),
        heat=np.array(heat, dtype=np.int64).reshape(-1, 3),
        heat_gain=np.array(gain, dtype=np.float64).reshape(-1, 2),
        measured=np.array([node[name] for name in network.measured], dtype=np.int64),
    )


class Matrices(NamedTuple):
    """C x' = -G_int x + B_u u (3), for N parameter vectors at once."""

    capacitance: Array
    """(N, n_x): the diagonal of C [J/K]."""
    internal: Array
    """(N, n_x, n_x): G_int [W/K], symmetric positive definite."""
    inputs: Array
    """(N, n_x, n_u): B_u = [G_ext B^(q)]."""


def assemble(network: Network, theta: Array) -> Matrices:
    """The matrices of (3) for `theta` (n_theta, N), in SI units."""
    shape = topology(network)
    n_x, count = len(network.nodes), theta.shape[1]
    internal = np.zeros((count, n_x, n_x))
    inputs = np.zeros((count, n_x, len(network.inputs)))
    for i, j, p in shape.edges.tolist():
        internal[:, i, i] += theta[p]
        if j < n_x:
            internal[:, j, j] += theta[p]
            internal[:, i, j] -= theta[p]
            internal[:, j, i] -= theta[p]
        else:
            inputs[:, i, j - n_x] += theta[p]
    (nodes, columns, entries), (constants, signs) = shape.heat.T, shape.heat_gain.T
    gains = constants[:, None] + signs[:, None] * theta[entries]
    np.add.at(inputs.transpose(1, 2, 0), (nodes, columns), gains)
    return Matrices(theta[shape.capacitance].T, internal, inputs)


def theta_vector(network: Network, values: Mapping[str, float] | None = None) -> Array:
    """theta (n_theta, 1) from named `values`; what is not named takes its nominal value."""
    given = values or {}
    theta = [given.get(parameter.name, parameter.nominal) for parameter in network.parameters]
    missing = [p.name for p, value in zip(network.parameters, theta, strict=True) if value is None]
    if missing:
        raise KeyError(f"no value for {', '.join(missing)}")
    return np.array(theta, dtype=np.float64)[:, None]
