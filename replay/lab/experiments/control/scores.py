"""What a controlled period cost, and how comfortable it was."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.energyplus.plant import STEP
from replay.lab.experiments.control.cases import STEPS_A_DAY, WARMEST, Scene, price
from replay.lab.experiments.control.loop import Lived
from replay.localtime import HOUR

_QUARTER = 3
"""Steps over which the peak is a mean, as in a bill."""
_ON = 1.0
"""W above which a heater counts as on."""


class Scores(NamedTuple):
    """Of the controlled days, over all rooms: `energy` [kWh], `cold` below and `warm` above the comfort band [K h],
    `peak` [kW, mean over 15 min], `switches` on per room and day, `fallback`: share of time under a thermostat."""

    energy: float
    cost: float
    cold: float
    warm: float
    peak: float
    switches: float
    fallback: float

    @property
    def discomfort(self) -> float:
        return self.cold + self.warm


def scores(scene: Scene, lived: Lived) -> Scores:
    since = scene.controlled_from
    local, air, heating = lived.local[since:], lived.air[since:], lived.heating[since:]
    life, hours = scene.life(), STEP / HOUR
    low = np.array([life.set_points(at) for at in local])
    power = heating.sum(axis=1)
    prices = np.array([price(at) for at in local])
    on = heating > _ON
    days = len(local) / STEPS_A_DAY
    quarters = power[: len(power) // _QUARTER * _QUARTER].reshape(-1, _QUARTER).mean(axis=1)
    return Scores(
        energy=float(power.sum() * hours / 1000.0),
        cost=float(prices @ power * hours / 1000.0),
        cold=_kelvin_hours(low - air),
        warm=_kelvin_hours(air - WARMEST),
        peak=float(quarters.max() / 1000.0),
        switches=float((on[1:] & ~on[:-1]).sum() / days / heating.shape[1]),
        fallback=float(1.0 - lived.planned[since:].mean()),
    )


def _kelvin_hours(beyond: Array) -> float:
    return float(np.maximum(beyond, 0.0).sum() * STEP / HOUR)


def cost_at(swept: Sequence[Scores], discomfort: float) -> float:
    """The cost of the controller `swept` over its settings at a `discomfort` [K h]: linear between those that no other
    beats in both, each used for a part of the time, and beyond them that of the last one."""
    points = sorted({(one.discomfort, one.cost) for one in swept})
    front: list[tuple[float, float]] = []
    for point in points:
        if not front or point[1] < front[-1][1]:
            front.append(point)
    return float(np.interp(discomfort, [at for at, _ in front], [cost for _, cost in front]))


def share_of_the_way(own: Scores, thermostat: Sequence[Scores], perfect: Sequence[Scores]) -> float:
    """How far `own` is on the way from the thermostat (0) to perfect knowledge (1), in cost at its own discomfort."""
    dear, cheap = (cost_at(swept, own.discomfort) for swept in (thermostat, perfect))
    return (dear - own.cost) / (dear - cheap) if dear > cheap else np.nan
