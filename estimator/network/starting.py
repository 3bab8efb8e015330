"""Where the state nodes of a network start."""

import numpy as np

from estimator.arrays import Array
from estimator.network.network import MEASURED, Network


def initial_temperatures(network: Network, outputs: Array, inputs: Array) -> tuple[Array, Array]:
    """Means [degC] and standard deviations [K] (n_x,) by each node's rule, from a first sample (n_y,) and (n_u,).

    An output that is missing (NaN) there counts as the first that is not.
    """
    first = outputs[~np.isnan(outputs)][0]
    measured = dict(zip(network.measured, np.where(np.isnan(outputs), first, outputs), strict=True))
    mean, sds = np.empty(len(network.nodes)), np.empty(len(network.nodes))
    for i, node in enumerate(network.nodes):
        rule = network.initial_temperature(node)
        sds[i] = rule.sd
        if rule.source == MEASURED:
            mean[i] = measured.get(node, first)
        elif isinstance(rule.source, str):
            mean[i] = inputs[network.inputs.index(rule.source)]
        else:
            mean[i] = rule.source
    return mean, sds
