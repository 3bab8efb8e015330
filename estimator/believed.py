"""Posterior quantiles of parameters that can be believed: an interval that has collapsed is none."""

from math import log
from typing import Any

import numpy as np

from estimator.arrays import Array
from estimator.types import Estimator, ParameterSummary

TAILS = (0.025, 0.5, 0.975)

NARROWEST = log(1.02)
"""Width of a 95 % interval of the logarithm of a parameter below which it says nothing: 2 %. No sensor in a room where
people live tells a capacitance or a conductance that well in years. Particles that descend from a few ancestors, or a
filter that takes correlated errors for independent ones, only seem to know it."""


def believed(estimator: Estimator, state: Any, levels: Array) -> ParameterSummary:
    """`estimator.parameters` at `levels` (L,); where they have collapsed, only medians are left, the others are NaN.

    Once one parameter is known too well, none is believed, nor what follows from them: particles that agree about one
    descend from few ancestors, and these may be wrong about the others.
    """
    every = np.unique(np.concatenate([levels, TAILS]))
    found = estimator.parameters(state, every)
    asked, tails = np.searchsorted(every, levels), np.searchsorted(every, TAILS)
    free = np.array([parameter.free for parameter in estimator.network.parameters], dtype=np.bool_)
    lower, _, upper = found.parameters[free][:, tails].T
    collapsed = bool((np.log(upper / lower) < NARROWEST).any())
    derived = len(found.time_constants) + 1
    marked = collapsed & np.concatenate([free, np.ones(derived, dtype=np.bool_)])
    gone = np.where(levels == TAILS[1], 0.0, np.nan) if collapsed else np.zeros(len(levels))
    return found._replace(
        levels=levels,
        parameters=found.parameters[:, asked] + np.where(free[:, None], gone, 0.0),
        time_constants=found.time_constants[:, asked] + gone,
        heat_loss=found.heat_loss[asked] + gone,
        coefficients=found.coefficients[:, asked] if found.coefficients.size else found.coefficients,
        collapsed=marked,
    )
