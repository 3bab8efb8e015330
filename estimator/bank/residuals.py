"""What members with physics get wrong again and again, hour by hour: a ridge regression of their errors.

The error of a forecast from sample k until k + h is regressed on y(k), its change over 6 h, its value a day before
k + h, the means of boundaries and sun over [k + 1, k + h), and the hour where a network knows habits. The heating is
not among them, so what another heating would do remains a matter of physics: unlike the direct regressions, corrected
members can be asked what a plan would bring.

As of those, regressions are fitted once a day, every correction that could have been made with the coefficients of its
time is held to the error that came, and the share of it that came true is made. None is larger than an error that was
seen.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.arrays import DAY, HOUR, Array, Indices
from estimator.bank.weights import between
from estimator.blackbox.regression import LEVEL, levels_and_scales
from estimator.blackbox.ridge import fitted, trusts
from estimator.heat.terms import HABIT, HABIT_HOURS
from estimator.network.network import Network
from estimator.types import Mixture
from estimator.verification.hindsight import EVERY, Due

_BACK = 6.0 * HOUR
"""s over which the output's last change is taken."""
_LEAST_SPREAD = {"1": 1.0, "output": 1.0, "change": 0.5, "day before": 0.5, "weather": 0.2, "hour": 0.25}
"""Below which a regressor, temperatures in K, counts as one that has hardly varied yet."""
_PENALTY_DAYS = 1.0
"""Days of forecasts that speak for no correction."""
_DOUBTED_LEADS, _LEAST_DOUBT = 2.0, 0.5
"""Leads, and days at least, of forecasts in which no correction has come true: as long as a lead, all err alike."""
_MEMORY_DAYS, _VERIFIED_MEMORY_DAYS = 60.0, 20.0
"""Time constants with which errors and verified corrections are forgotten."""


class Residuals(NamedTuple):
    """M members, n_y outputs, H horizons, the first of which is one step and never corrected, p regressors."""

    outputs: Array
    """(n_y, D) [degC]: those of the last 30 h up to the state's time, held where nothing was measured. What nobody
    knows counts as the first that was measured, and is NaN before that."""
    moments: Array
    """(M, n_y, H, p, p + 1): discounted sums of x x' and, in the last column, of x times the error."""
    coefficients: Array
    """(2, M, n_y, H, p): those of the last daily fit, and of the one before."""
    fitted: Array
    """(): steps since that fit."""
    verified: Array
    """(M, n_y, H, 4): discounted sums over verified forecasts: of their number, of correction times error, and of the
    squares of both [K^2]."""
    largest: Array
    """(M, n_y, H): the largest error so far [K]."""
    members: Array
    """(M,): places in the bank of those that are corrected."""


class Corrector:
    """The regressions of one bank. It has no state."""

    def __init__(self, network: Network, period: float, leads: Sequence[int], members: Sequence[int]) -> None:
        """`network` is the one whose drive rows come; `members` are the places in the bank of those to correct, whose
        forecasts are verified at `leads` (H,)."""
        self.members = tuple(members)
        self._leads = tuple(leads)
        self._day, self._back = max(1, round(DAY / period)), max(1, round(_BACK / period))
        sun = [heat.channel for heat in network.heat_inputs if heat.unit == "W/m2" or heat.channel == network.clouds]
        self._weather = [network.inputs.index(name) for name in (*network.boundaries, *dict.fromkeys(sun))]
        self._level, self._scale = (rows[self._weather] for rows in levels_and_scales(network))
        series = [None] * len(network.inputs) + [term.series for term in network.terms]
        habits = [f"{HABIT}{hour:02}" for hour in HABIT_HOURS]
        self._hats = [series.index(name) for name in habits if name in series]
        kinds = ["1", "output", "change", "day before"] + ["weather"] * len(self._weather) + ["hour"] * len(self._hats)
        self._least = np.array([_LEAST_SPREAD[kind] for kind in kinds]) ** 2
        self._none = np.zeros((len(leads), len(kinds)))
        a_day = DAY / (max(1, round(EVERY / period)) * period)
        self._penalty = _PENALTY_DAYS * a_day
        self._doubted = np.maximum(_DOUBTED_LEADS * np.array(leads) / self._day, _LEAST_DOUBT) * a_day
        self._kept = [math.exp(-1.0 / (days * a_day)) for days in (_MEMORY_DAYS, _VERIFIED_MEMORY_DAYS)]

    def start(self, outputs: Array) -> Residuals:
        """Nothing has been verified; `outputs` (n_y,) are those of the first sample, NaN for a missing one."""
        shape = len(self.members), len(outputs), len(self._leads)
        width = len(self._least)
        return Residuals(
            outputs=np.tile(outputs[:, None], self._day + self._back + 1),
            moments=np.zeros((*shape, width, width + 1)),
            coefficients=np.zeros((2, *shape, width)),
            fitted=np.array(0, dtype=np.int64),
            verified=np.zeros((*shape, 4)),
            largest=np.zeros(shape),
            members=np.array(self.members, dtype=np.int64),
        )

    def restart(self, known: Residuals, outputs: Array) -> Residuals:
        """The first sample after a gap: what was learned, and nothing of the last hours."""
        return known._replace(outputs=self.start(outputs).outputs)

    def predict(self, known: Residuals) -> Residuals:
        """One step on."""
        held = np.concatenate([known.outputs[:, 1:], known.outputs[:, -1:]], axis=1)
        return known._replace(outputs=held, fitted=known.fitted + 1)

    def corrections(self, known: Residuals, drive: Array, after: Indices) -> Array:
        """(M, n_y, L): to add to what is forecast [K] after so many rows (L,) of `drive` (h, n), from the state's time
        on, one step after the last sample."""
        rows = self._regressors(known.outputs, known.outputs.shape[1] - 2, drive, after)
        told = _told(known.coefficients[0][:, :, :, None], rows[:, None], known.largest[..., None])
        made = self._trusts(known)[..., None] * told
        shares = between(np.eye(len(self._leads)), self._leads, np.asarray(after + 1.0))
        return np.asarray((made * shares).sum(axis=2))

    def judged(
        self, known: Residuals, due: Sequence[Due], drive: Array, outputs: Array
    ) -> tuple[Residuals, tuple[Due, ...]]:
        """What is known after the `outputs` (n_y,) of a sample, NaN for a missing one, and what was `due` for it with
        its corrections. `drive` (m, n) are the rows until the sample, the newest last."""
        newest = np.where(np.isnan(outputs), known.outputs[:, -1], outputs)
        past = np.where(np.isnan(known.outputs), newest[:, None], known.outputs)
        past[:, -1] = newest
        moments, verified, largest = known.moments.copy(), known.verified.copy(), known.largest.copy()
        shares, corrected, age = self._trusts(known), [], known.fitted
        for one in due:
            n, rest = self._leads.index(one.lead), one.lead - 1
            origin = past.shape[1] - 1 - one.lead
            rows = self._regressors(past, origin, drive[len(drive) - rest :], np.array([rest]))[:, 0]
            then = known.coefficients[0 if one.lead <= age else 1][:, :, n]
            told = _told(then, rows, known.largest[:, :, n])
            errors = np.array([outputs - one.mixtures[place].mean() for place in self.members])
            mixtures = list(one.mixtures)
            for m, place in enumerate(self.members):
                mixtures[place] = _moved(mixtures[place], shares[m, :, n] * told[m])
            corrected.append(one._replace(mixtures=tuple(mixtures)))
            for m, i in np.argwhere(np.isfinite(errors)).tolist():
                error, correction, row = errors[m, i], told[m, i], rows[i]
                moments[m, i, n] = self._kept[0] * moments[m, i, n] + row[:, None] * np.append(row, error)
                sums = np.array([1.0, correction * error, correction**2, error**2])
                verified[m, i, n] = self._kept[1] * verified[m, i, n] + sums
                largest[m, i, n] = max(largest[m, i, n], abs(error))
        coefficients = known.coefficients
        if age >= self._day:
            flat = moments.reshape(-1, *moments.shape[2:])
            fresh = fitted(flat, self._least, self._penalty, self._none).reshape(coefficients.shape[1:])
            coefficients, age = np.stack([fresh, coefficients[0]]), np.zeros_like(age)
        after = Residuals(past, moments, coefficients, age, verified, largest, known.members)
        return after, tuple(corrected)

    def _regressors(self, outputs: Array, origin: int, drive: Array, after: Indices) -> Array:
        """(n_y, L, p): those of forecasts from the sample at the place `origin` of `outputs` (n_y, D), after so many
        rows (L,) of `drive` (h, n); 0 where nobody knows them."""
        own = outputs[:, origin, None]
        before = origin + (after + 1) - self._day * -(-(after + 1) // self._day)
        change, day_before = own - outputs[:, origin - self._back, None], outputs[:, before] - own
        weather = np.cumsum((drive[:, self._weather] - self._level) / self._scale, axis=0)[after - 1] / after[:, None]
        alike = np.concatenate([weather, drive[after - 1][:, self._hats]], axis=1)
        shape = len(outputs), len(after)
        each = [np.broadcast_to(rows, shape)[..., None] for rows in (np.ones(1), own - LEVEL, change, day_before)]
        return np.nan_to_num(np.concatenate([*each, np.broadcast_to(alike, (*shape[:1], *alike.shape))], axis=-1))

    def _trusts(self, known: Residuals) -> Array:
        """(M, n_y, H): share of a correction that has come true."""
        flat = known.verified.reshape(-1, *known.verified.shape[2:])
        return np.asarray(trusts(flat, self._doubted, np.zeros(len(self._leads)))).reshape(known.largest.shape)


def _told(coefficients: Array, rows: Array, largest: Array) -> Array:
    """What `coefficients` (..., p) foretell from regressors `rows` (..., p), within the `largest` error."""
    return np.clip((coefficients * rows).sum(axis=-1), -largest, largest)


def _moved(mixture: Mixture, by: Array) -> Mixture:
    """`mixture` moved by so much (n_y,) [K]."""
    return mixture._replace(means=mixture.means + by[:, None])
