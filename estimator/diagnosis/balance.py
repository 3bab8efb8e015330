"""The record's own energy balance, against which the learned heat loss is held.

In steady state the temperature of the first measured node is sum_b w_b T_b + sum_h r_h q_h over boundaries b and heat
flows h, with w_b and r_h from G_int^-1 B_u (paper (3) with x' = 0; the w_b sum to 1). Over days whose ends are alike,
storage cancels, and sum_b w_b (T_i - T_b) = sum_h r_h q_h holds for the sums too. If the right side is c times the left
side, the heat loss that the record needs is c times that of the model.
"""

from typing import NamedTuple

import numpy as np

from estimator.arrays import DAY, Array
from estimator.diagnosis.finding import AGAINST_BALANCE, Finding, amount
from estimator.diagnosis.record import DAYS, Record
from estimator.network.assembly import assemble
from estimator.network.discretise import heat_loss
from estimator.network.network import Network
from estimator.types import ParameterSummary

FEWEST_DAYS = 4
"""Shortest window. Four days of a heated dwelling (150 W/K over 15 K) are 800 MJ; a heavy one (100 MJ/K) stores at most
an eighth of that for each kelvin by which the ends differ."""

_COVERED = 0.75
"""Share of a day that must have been measured: less may have left out its night or its heating."""

_INDOOR_ALIKE, _OUTDOOR_ALIKE = 1.0, 5.0
"""K by which the daily means of the first and the last day may differ, indoors and at every boundary. The envelope
follows the boundaries only in part."""

_LEAST_DIFFERENCE = 3.0
"""K: with a smaller mean difference to the boundaries, people and appliances (3 to 5 W/m2) outweigh the heating."""

_LEAST_KNOWN = 0.5
"""Share of the heat that must come through inputs with a known gain; the rest rests on learned gains."""

LOWEST, HIGHEST = 0.5, 2.0
"""Range of the learned heat loss over that of the balance. Unmeasured gains and a wrong aperture explain a quarter to a
third; a factor of two is another building."""


class Balance(NamedTuple):
    """The heat loss [W/K] that `days` days of the record need."""

    heat_loss: float
    days: int


def balance(network: Network, theta: Array, record: Record) -> Balance | None:
    """The balance of `record` for a model with `theta` (n_theta,); None where the record does not allow one."""
    window = _window(network, record)
    if window is None or not np.isfinite(theta).all():
        return None
    weights = np.ones(len(window))
    # The sums then run from the middle of the first day to the middle of the last, whose means are alike.
    weights[0] = weights[-1] = 0.5
    output, inputs = weights @ record.output[window], weights @ record.inputs[window]
    seconds = weights @ record.seconds[window]
    matrices = assemble(network, theta[:, None])
    node = network.nodes.index(network.measured[0])
    steady = np.linalg.solve(matrices.internal[0], matrices.inputs[0])[node]
    boundaries = len(network.boundaries)
    needed = float(steady[:boundaries] @ (output - inputs[:boundaries]))
    brought = steady[boundaries:] * inputs[boundaries:]
    known = brought[[_known(network, channel) for channel in network.heat_channels]].sum()
    total = brought.sum()
    if needed < _LEAST_DIFFERENCE * seconds or not known >= _LEAST_KNOWN * total > 0.0:
        return None
    return Balance(float(total / needed * heat_loss(matrices, node)[0]), len(window))


def against_balance(network: Network, summary: ParameterSummary, record: Record) -> list[Finding]:
    """The finding that the learned heat loss, with its whole interval, is at odds with the record's balance.

    `summary` has the median in the middle and the interval's ends at its ends.
    """
    middle = len(summary.levels) // 2
    found = balance(network, summary.parameters[:, middle], record)
    lower, median, upper = summary.heat_loss[[0, middle, -1]].tolist()
    if found is None or not (upper < LOWEST * found.heat_loss or lower > HIGHEST * found.heat_loss):
        return []
    heat = ", ".join(channel for channel in network.heat_channels if _known(network, channel))
    problem = (
        f"the learned heat loss of {amount(median)} W/K ({amount(lower)} to {amount(upper)}) contradicts the energy "
        f"balance of the last {found.days} days, which needs about {amount(found.heat_loss)} W/K"
    )
    sentence = f"{problem}; check unit and scale of {heat}, and whether other heating is not measured"
    return [Finding(AGAINST_BALANCE, "heat_loss", sentence)]


def known_heat(network: Network) -> tuple[str, ...]:
    """Heat channels whose total gain over all nodes is known, be it that shares of it are learned."""
    return tuple(channel for channel in network.heat_channels if _known(network, channel))


def _known(network: Network, channel: str) -> bool:
    signs: dict[str, float] = {}
    for heat in network.heat_inputs:
        if heat.channel == channel and heat.gain.parameter is not None:
            signs[heat.gain.parameter] = signs.get(heat.gain.parameter, 0.0) + heat.gain.sign
    learned = {parameter.name for parameter in network.parameters if parameter.free}
    return channel != network.clouds and not any(sign and name in learned for name, sign in signs.items())


def _window(network: Network, record: Record) -> list[int] | None:
    """Rows of the longest run of days whose ends are alike, in order; None where there is none of FEWEST_DAYS."""
    rows = [row for row in np.argsort(record.days).tolist() if record.seconds[row] >= _COVERED * DAY]
    means = np.column_stack([record.output, record.inputs[:, : len(network.boundaries)]])
    means = means / np.maximum(record.seconds, 1.0)[:, None]
    limits = np.array([_INDOOR_ALIKE] + [_OUTDOOR_ALIKE] * len(network.boundaries))
    for length in range(min(len(rows), DAYS), FEWEST_DAYS - 1, -1):
        for first in range(len(rows) - length, -1, -1):
            window = rows[first : first + length]
            unbroken = record.days[window[-1]] - record.days[window[0]] == length - 1
            if unbroken and (np.abs(means[window[-1]] - means[window[0]]) <= limits).all():
                return window
    return None
