"""Hidden temperatures behind a recording: what a fitted network says of them when its measured nodes follow the data.

Open-loop windows have to start somewhere (paper 4.3.3: "re-initialised at the first sample"). The hidden nodes of a
simulation that has drifted off the measurement have drifted with it; those of one that is led by it have not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from estimator.offline.open_loop import OpenLoop
from replay.scores.windows import Window


def simulate(
    network: Network,
    period: float,
    columns: Mapping[str, Array],
    windows: Sequence[Window],
    theta: Array,
    starts: Array,
) -> Array:
    """States (K, n_x) [degC] open loop through each of `windows` from `starts` (len(windows), n_x); NaN elsewhere.

    `columns` holds the channels (K,) of `network` by name, sampled every `period` s.
    """
    loop = OpenLoop(network, period)
    inputs = np.column_stack([columns[channel] for channel in network.inputs])
    states = np.full((len(inputs), len(network.nodes)), np.nan)
    for (begin, end), start in zip(windows, starts, strict=True):
        states[begin:end] = loop.simulate(theta, start, inputs[begin:end]).states
    return states


def follow(
    network: Network,
    period: float,
    columns: Mapping[str, Array],
    windows: Sequence[Window],
    theta: Array,
    starts: Array,
) -> Array:
    """As `simulate`, but measured nodes take their measurement, held over each step, and lead the hidden ones.

    Where a measurement is missing, the open-loop simulation stands in.
    """
    states = simulate(network, period, columns, windows, theta, starts)
    led = [network.nodes.index(node) for node in network.measured]
    for place, node in zip(led, network.measured, strict=True):
        states[:, place] = np.where(np.isnan(columns[node]), states[:, place], columns[node])
    hidden = [place for place in range(len(network.nodes)) if place not in led]
    if hidden:
        rest = _without_measured(network)
        values = dict(columns) | {node: states[:, place] for place, node in zip(led, network.measured, strict=True)}
        kept = [[parameter.name for parameter in network.parameters].index(p.name) for p in rest.parameters]
        states[:, hidden] = simulate(rest, period, values, windows, theta[kept], starts[:, hidden])
    return states


def _without_measured(network: Network) -> Network:
    """`network` with its measured nodes as boundaries: what is left are the hidden nodes."""
    hidden = [node for node in network.nodes if node not in network.measured]
    edges = tuple(edge for edge in network.conductances if any(node in hidden for node in edge.between))
    heat = tuple(h for h in network.heat_inputs if h.node in hidden)
    capacitances = {node: network.capacitances[node] for node in hidden}
    used = {*capacitances.values(), *(edge.name for edge in edges)} | {h.gain.parameter for h in heat}
    return replace(
        network,
        capacitances=capacitances,
        boundaries=tuple(
            b for b in (*network.boundaries, *network.measured) if any(b in edge.between for edge in edges)
        ),
        conductances=edges,
        heat_inputs=heat,
        parameters=tuple(parameter for parameter in network.parameters if parameter.name in used),
        measured=tuple(hidden),
        initial={},
    ).validate()


def frozen(network: Network, theta: Array) -> Network:
    """`network` with every parameter held at `theta` (n_theta,): what is left to fit are the temperatures it starts
    from."""
    for parameter, value in zip(network.parameters, theta, strict=True):
        network = network.with_parameter(parameter.name, nominal=float(value), free=False)
    return network
