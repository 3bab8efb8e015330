"""What it costs that a zone without a sensor takes the sky for clear.

Under a clear sky the terms of the sun bring the room the heat s(t). With clouds it gets more or less of it than on the
mean day, so the heat that the model misses has the shape of s(t), on some days above and on others below nought.
Errors of the model, and people who are there all day, are found by the same weights half a day later as well.
"""

from typing import Any

import numpy as np

from estimator.arrays import DAY, Array
from estimator.diagnosis.finding import TAKEN_FOR_CLEAR, Finding, amount
from estimator.diagnosis.telemetry.recent import Recent, begins, slot, until
from estimator.heat.terms import CLEAR
from estimator.statespace.inverse import Driving, known_heat, missing_heat
from estimator.types import Estimator

_DRAWS = 64
"""Of the posterior, whose mean is the model."""

_FEWEST_DAYS = 7
"""Sunny days, of those that are remembered. The variances of two samples of 7 differ by a factor of 4.3 in one case of
20 where those of the populations are the same."""

_BEYOND = 4.0
"""Variance of days over that of nights from which it is the sun that makes the difference."""

_MOST = 0.75
"""Standard deviation of the sun over its mean that clouds cause at most, for they let a quarter of it through: where
one day of four is clear. What differs more is something else."""

_FELT = 0.5
"""K: a difference of heat that is worth a sensor, over the heat loss."""


def taken_for_clear(
    estimator: Estimator, state: Any, heat_loss: float, recent: Recent, driving: Driving
) -> list[Finding]:
    """The finding that clouds, of which nothing is told, matter to a room with this `heat_loss` [W/K]: by what was
    measured in the last fortnight (`recent`) and what drives the zone at any time (`driving`)."""
    network = estimator.network
    # What shines into other measured rooms does not heat this one.
    clear = [term.series.startswith(CLEAR) and term.node not in network.measured[1:] for term in network.terms]
    if network.clouds is not None or not any(clear) or np.isnan(recent.times).all():
        return []
    draws = estimator.draws(state, _DRAWS)
    if draws is None or len(draws.network.terms) < len(network.terms):
        return []
    end, step = float(np.nanmax(recent.times)) + slot(recent), slot(recent)
    times, rows = begins(recent, end), until(recent, end)
    known = known_heat(draws, network, driving, times, rows[:, 1:])
    sun = known[:, len(network.inputs) :][:, clear].sum(axis=1)
    missed = missing_heat(draws, times, step, rows[:, 0], known)
    measured = np.isfinite(rows[:, 0])
    noon = float(np.angle((sun * np.exp(2j * np.pi * times / DAY)).sum())) / (2 * np.pi) * DAY
    by_day, by_night = (
        _daily(missed, np.roll(sun, round(late / step)) * measured, (times - noon + DAY / 2 - late) // DAY)
        for late in (0.0, DAY / 2)
    )
    if min(len(by_day), len(by_night)) < _FEWEST_DAYS:
        return []
    usual, spread = float((sun**2).sum() / sun.sum()), float(np.sqrt(max(by_day.var() - by_night.var(), 0.0)))
    if by_day.var() < _BEYOND * by_night.var() or not _FELT * heat_loss < spread < _MOST * usual:
        return []
    sentence = (
        f"the sky is taken for clear, and the {amount(usual)} W that the sun is reckoned to give by day are "
        f"{amount(spread)} W more or less from one day to the next, by clouds or by people who come on some days only; "
        "measure the irradiance as I_sol, or add the channel cloud_cover of a weather service"
    )
    return [Finding(TAKEN_FOR_CLEAR, "zone", sentence)]


def _daily(values: Array, weights: Array, days: Array) -> Array:
    """Means of `values` (K,) by `weights` (K,), of each of the `days` (K,) that has at least half of the usual."""
    names, places = np.unique(days, return_inverse=True)
    whole = np.bincount(places, weights, len(names))
    sums = np.bincount(places, weights * values, len(names))
    enough = whole > 0.5 * np.median(whole)
    return np.asarray(sums[enough] / whole[enough])
