"""Cost at equal discomfort: what a controller with several settings would have paid to be as comfortable as another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from replay.lab.experiments.control.scores import Scores


def cost_at(swept: Sequence[Scores], discomfort: float) -> float:
    """The cost of the controller that was `swept` over its settings, at a `discomfort` [K h].

    Linear between the settings that no other beats in both, which is what it costs to use one setting for a part of the
    time and the other for the rest. Beyond them it is the cost of the last one.
    """
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
