"""What futures that run the thermostat answer: when to start heating, how much energy, what another plan changes.

All answers are read off the same weighted futures as the fan, so that they agree with it. Two plans are compared future
by future: what both have in common, the weather and much of a model's own uncertainty, cancels out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from estimator.arrays import Array, Indices
from estimator.thermostat.live import Heat
from estimator.types import Mixtures

JOULES = 3.6e6
"""J in a kWh."""
_TINY = 1e-12
"""K2, or kWh2."""
_SHARED = 0.25
"""What all models of a room err by together, as a share of what another plan changes: their structure is the same. What
was told to be saved in three buildings of EnergyPlus was off by .19 to .42 (rms) of that."""


class Amounts(NamedTuple):
    """A quantity of B spans of time, by N weighted futures."""

    values: Array
    """(N, B)."""
    weights: Array
    """(N, B): those of each span add up to 1."""
    weather: Indices
    """(N,): whoever has the same number has the same weather; -1 for what does not ask for it."""

    def mean(self) -> Array:
        """(B,)."""
        return np.asarray((self.values * self.weights).sum(axis=0), dtype=np.float64)

    def stretched(self, scales: Array) -> Amounts:
        """The same with every distance from the mean of a span `scales` (B,) times as long, be it below nothing."""
        mean = self.mean()
        return self._replace(values=mean + scales * (self.values - mean))

    def unsure(self) -> Array:
        """(B,): by which a difference is to be `stretched` for what all models err by together."""
        mean = self.mean()
        variance = (self.weights * np.square(self.values - mean)).sum(axis=0)
        return np.asarray(np.sqrt(1.0 + np.square(_SHARED * mean) / np.maximum(variance, _TINY)), dtype=np.float64)

    def about(self, means: Array) -> Amounts:
        """The same, moved to `means` (B,)."""
        return self._replace(values=self.values + (means - self.mean()))

    def quantiles(self, levels: Array) -> Array:
        """(B, L): the smallest value at which the weights add up to each of `levels` (L,)."""
        order = np.argsort(self.values, axis=0, kind="stable")
        values = np.take_along_axis(self.values, order, axis=0)
        reached = np.cumsum(np.take_along_axis(self.weights, order, axis=0), axis=0)
        found = np.empty((values.shape[1], len(levels)))
        for span in range(values.shape[1]):
            places = np.searchsorted(reached[:, span], np.asarray(levels) - 1e-12)
            found[span] = values[np.minimum(places, len(values) - 1), span]
        return found


def energy(heat: Heat, period: float, spans: Indices | None = None, price: Array | None = None) -> Amounts:
    """The energy [kWh] that goes into a zone in each span; what it costs at a `price` (h,) of a kWh in each step.

    `heat` is that of h steps of `period` s; `spans` (h,) numbers the span of every step, from 0 on; without it there is
    one. Heat that is taken, by a cooler, counts as well. The mean of a span is the sum of the means of its steps, in
    which a future may weigh differently.
    """
    each = np.abs(heat.values).sum(axis=2) * period / JOULES
    if price is not None:
        each = each * price
    spans = np.zeros(each.shape[1], dtype=np.int64) if spans is None else spans
    means = (each * heat.weights.T).sum(axis=0) / heat.weights.sum(axis=1)
    amounts = Amounts(_summed(each, spans), _means(heat.weights.T, spans), heat.weather)
    return amounts.about(_summed(means[None], spans)[0])


def below(temperatures: Array, setpoints: Array, weights: Array, period: float, tolerance: float) -> Amounts:
    """(N, 1): hours in which N futures, `temperatures` (N, h) [degC] with `weights` (h, N), are below `setpoints` (h,)
    by more than `tolerance` [K]; steps without a set-point (NaN) do not count."""
    cold = (temperatures < setpoints - tolerance).astype(np.float64) * (period / 3600.0)
    whole = np.zeros(temperatures.shape[1], dtype=np.int64)
    return Amounts(_summed(cold, whole), _means(weights.T, whole), np.full(len(cold), -1))


def difference(one: Amounts, other: Amounts) -> Amounts:
    """`one` less `other`, future by future: both must be of the same futures, under two plans."""
    weights = 0.5 * (one.weights + other.weights)
    return one._replace(values=one.values - other.values, weights=weights).about(one.mean() - other.mean())


def probability_reached(outputs: Mixtures, value: float, swings: Array) -> float:
    """That the first output is at least `value` [degC] at some of h times.

    Each component of `outputs` is a future that errs the same way throughout, but for the swing of a room around its
    set-point, which is over in an hour: every future swings as each of `swings` (J, h) [K] did, see
    `estimator.thermostat.memory.swings`, and what the futures differ by has that part taken out.
    """
    means, weights = outputs.means[:, 0], outputs.weights[-1] / outputs.weights[-1].sum()
    middle = (means @ weights)[:, None]
    spread = np.square(means - middle) @ weights
    lasting = np.sqrt(np.clip(1.0 - swings.var() / np.maximum(spread, _TINY), 0.0, 1.0))[:, None]
    above = (middle + lasting * (means - middle))[:, :, None] + swings.T[:, None, :] - value
    return float(weights @ ndtr(above / outputs.sds[:, 0, :, None]).max(axis=0).mean(axis=1))


def latest(reached: Callable[[int], float], last: int, wanted: float) -> int | None:
    """The latest of the steps 0 to `last` at which to start for `reached(step)`, a probability that falls with the
    step, to be at least `wanted`; None if not even step 0 does."""
    if reached(last) >= wanted:
        return last
    low, high = -1, last
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if reached(middle) >= wanted else (low, middle)
    return None if low < 0 else low


def _summed(each: Array, spans: Indices) -> Array:
    """(N, B) of (N, h)."""
    found = np.zeros((len(each), int(spans.max(initial=0)) + 1))
    np.add.at(found.T, spans, each.T)
    return found


def _means(each: Array, spans: Indices) -> Array:
    """(N, B): the weights of the spans, of (N, h) those of the steps."""
    summed = _summed(each, spans)
    return np.asarray(summed / summed.sum(axis=0), dtype=np.float64)
