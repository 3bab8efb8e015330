"""Forecasts that no room can follow."""

from math import ceil
from typing import Any

import numpy as np

from estimator.arrays import HOUR, Array
from estimator.diagnosis.balance import known_heat
from estimator.diagnosis.finding import IMPLAUSIBLE, Finding, amount
from estimator.network.presets import takes_box
from estimator.types import Estimator

COLDEST, HOTTEST = -30.0, 60.0
"""degC: an unheated shed in a hard winter, and an unventilated attic in summer."""

FASTEST = 15.0
"""K per hour: 100 W/m2, a generous heater, warms the air and surfaces of a light room (15 Wh/(m2 K)) by 7 K in the
first hour. Twice that is no room."""

_DRAWS = 64
"""Draws that a test forecast stands for at most; its mean is compared with limits that are far away."""


def implausible(estimator: Estimator, state: Any, inputs: Array, largest: Array) -> list[Finding]:
    """The finding that a forecast from `state` is implausible: the next step, or an hour without and with full heating.

    `inputs` (n_u,) are those in force, `largest` (n_u,) the largest so far: full heating is the largest known one.
    Means are tested, for the ends of an interval may lie anywhere while little is known.
    """
    network, steps = estimator.network, ceil(HOUR / estimator.period)
    heat = [network.inputs.index(channel) for channel in known_heat(network) if network.channel_unit(channel) == "W"]
    off, full = inputs.copy(), inputs.copy()
    off[heat], full[heat] = 0.0, largest[heat]
    issue = estimator.issue(state, _DRAWS)
    # Neither sun nor people.
    plans = (np.tile(np.pad(row, (0, len(network.terms))), (steps, 1)) for row in (off, full))
    cold, warm = (np.array([mixture.mean() for mixture in estimator.unfold(issue, plan).each()]) for plan in plans)
    both = np.concatenate([cold, warm])
    # An hour of full heating says little where a step is longer than that.
    rise = float(np.max(warm[-1] - cold[-1])) / (steps * estimator.period / HOUR)
    farthest = both.ravel()[np.argmax(np.abs(both - (COLDEST + HOTTEST) / 2.0))]
    power = amount(float(largest[heat].sum()))
    if not np.isfinite(both).all() or not COLDEST <= farthest <= HOTTEST:
        problem = f"the model forecasts {amount(farthest)} degC within an hour"
    elif rise > FASTEST:
        problem = f"in the model, full heating ({power} W) warms the zone by {amount(rise)} K in an hour"
    else:
        return []
    sentence = (
        f"{problem}, which no room does; do not let a controller use the forecasts yet, check the unit of the heating, "
        "and narrow the bounds of the network or wait for some days of data"
    )
    if takes_box(network):
        sentence = (
            f"{problem}, which no room does; do not let a controller use the forecasts yet, check the unit of the "
            "heating, and give the floor area (box = { floor_area = 120 }) or wait for some days of data"
        )
    return [Finding(IMPLAUSIBLE, "zone", sentence)]
