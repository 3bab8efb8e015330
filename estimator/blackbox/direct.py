"""A direct ridge regression: for each of some leads a regression of its own of the change until then.

y(k+h) - y(k) is regressed on y(k), its changes over a step, 1 h and 6 h, its value 24 h before the target, the means of
every input over [k, k+h), over the last 1 and 3 h of that and over the last 1, 6 and 24 h before k, and sine and cosine
of the target's hour. Between the leads forecasts are interpolated; beyond a day the forecast of the first is the past
of the second. (Direct against iterated forecasts: Marcellino, Stock and Watson 2006.)

Regressions are fitted once a day, and every forecast that could have been made with the coefficients of its time is
held to what came: by how much the changes that they foretell are to be believed (between 0, which is persistence, and
1), and the spread, follow from that. Until then half of a change within half a day is believed. No forecast changes by
more than was ever seen to change in that time. A regression that knows no inputs to come begins with the day before.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from estimator.arrays import DAY, HOUR, Array
from estimator.blackbox.options import DirectOptions
from estimator.blackbox.regression import FARTHEST, LEVEL, Regression
from estimator.blackbox.ridge import fitted, trusts
from estimator.network.network import Network
from estimator.types import Mixture, Mixtures, Outcome, Posterior

_LEADS = (0.0, 1.0, 2.0, 3.0, 6.0, 9.0, 12.0, 15.0, 18.0, 21.0, 24.0)
"""h; the first is one step."""
_PAST = (1.0, 6.0, 24.0)
"""h before k over which inputs are averaged."""
_LAST = (1.0, 3.0)
"""h before the target over which they are."""
_CHANGES = (1.0, 6.0)
"""h over which the output's last change is taken, beside one step."""
_OWN = 8
"""Regressors that are no inputs: 1, the output, three changes, the day before, sine and cosine."""
CLOCK = slice(_OWN - 2, _OWN)
"""Places of sine and cosine of the hour among the regressors."""
_DAY_BEFORE = 5
"""Place of the output's value a day before the target."""
_LEAST_SPREAD = np.array([1.0, 1.0, 0.1, 0.2, 0.5, 0.5, 0.5, 0.5])
"""Of those regressors, below which a regressor counts as one that has hardly varied yet."""
_LEAST_INPUT_SPREAD = 0.2
_HOUR_SD, _GROWTH, _GROWN = 0.35, 1.0 / 3.0, 6.0
"""Standard deviation [K] of a forecast an hour ahead before any was verified, the power of the lead with which it
grows, less than that of a random walk, and the hours after which it no longer does, for days are alike."""
_HALF_A_DAY = 12.0
"""h: as far as a lead is longer, what it lets expect is that of a lead as much shorter than a day. And of longer leads
a first day shows too few changes that do not overlap for a regression on it to be believed."""
_BELIEVED, _DOUBTED = 0.5, 0.5
"""Share of a foretold change that is believed beforehand, and the days of forecasts that this counts as."""
_SETTLES = 6.0
"""h with which a temperature is expected to come back to that of the day before."""
_PRESUMED = 0.5
"""What an expected spread counts as, in forecasts that do not overlap."""
_LEAST_SD = 1e-3


class DirectState(NamedTuple):
    """n_y outputs, L leads, p regressors; D steps are two days."""

    outputs: Array
    """(n_y, D + 1) [degC], the newest last; forecasts where nothing was measured."""
    measured: Array
    """(n_y, D + 1): 1 where an output was measured since the last gap, else 0."""
    inputs: Array
    """(D, n_u), the newest last."""
    step: Array
    """(): steps since the start, for the hour."""
    moments: Array
    """(n_y, L, p, p + 1): discounted sums of x x' and, in the last column, of x (y(k+h) - y(k))."""
    coefficients: Array
    """(2, n_y, L, p): those of the last daily fit, and of the one before."""
    fitted: Array
    """(): steps since that fit."""
    verified: Array
    """(n_y, L, 5): discounted sums over verified forecasts: of their number, of the foretold change times the real one,
    of its square, of the real change's square, and of the squared errors [K^2]."""
    seen: Array
    """(n_y, L, 2): the lowest and the highest change so far [K]; 0 is among them."""


class _Grid(NamedTuple):
    """What every regression of a zone knows of its time and its inputs."""

    leads: Array
    """(L,): steps ahead, ascending."""
    windows: Array
    """Steps of _PAST, _LAST and _CHANGES."""
    day: int
    """Steps of a day."""
    level: Array
    scale: Array
    """(n_u,): of the inputs, which count as (u - level) / scale."""
    foresees: bool
    """Whether inputs to come are known."""


class DirectIssue(NamedTuple):
    """What a forecast needs of a state: the last day, and the regressions."""

    outputs: Array
    measured: Array
    inputs: Array
    step: Array
    coefficients: Array
    """(n_y, L, p)."""
    trust: Array
    """(n_y, L): 0 to 1."""
    sds: Array
    """(n_y, L) [K]."""
    seen: Array


class Direct(Regression):
    """The model of one zone. See `estimator.types.Estimator` for the moves."""

    state_type = DirectState

    def __init__(self, network: Network, period: float, options: DirectOptions) -> None:
        super().__init__(network, period)
        self.options = options
        self._day = max(1, round(DAY / period))
        self._leads = np.unique([max(1, round(hours * HOUR / period)) for hours in _LEADS])
        self._presumed = _PRESUMED * self._leads.astype(np.float64)
        """(L,): what the spread that a shorter lead lets expect counts as, in forecasts."""
        hours = self._leads * period / HOUR
        far = hours > _HALF_A_DAY
        self._growth = np.exp(2.0 * _GROWTH * np.diff(np.log(np.minimum(hours, _GROWN)), prepend=0.0))
        """(L,): the variance to expect over that of the lead `_like`, for the first over that of an hour."""
        mirrored = np.abs(hours - np.maximum(DAY / HOUR - hours, _GROWN)[:, None]).argmin(axis=1)
        self._like = np.where(far, mirrored, np.arange(len(hours)) - 1)
        self._believed = np.where(far, 0.0, _BELIEVED)
        """(L,): share of a foretold change that is believed before any was verified."""
        self._doubted = np.full(len(self._leads), _DOUBTED * self._day)
        windows = np.array([max(1, round(hours * HOUR / period)) for hours in (*_PAST, *_LAST, *_CHANGES)])
        self._grid = _Grid(self._leads, windows, self._day, self.level, self._scale, not options.blind)
        means = len(_PAST) + (1 + len(_LAST)) * self._grid.foresees
        self._width = _OWN + means * len(network.inputs)
        least = np.full(self._width, _LEAST_INPUT_SPREAD)
        least[:_OWN] = _LEAST_SPREAD
        self._least = least**2
        self._prior = np.zeros((len(self._leads), self._width))
        """(L, p): the coefficients before any fit, to which the ridge draws."""
        if options.blind:
            self._prior[:, _DAY_BEFORE] = 1.0 - np.exp(-hours / _SETTLES)
        self._forgetting = math.exp(-period / (options.memory_days * DAY))
        self._verified_memory = options.verified_memory_days * DAY / period

    @property
    def issue_type(self) -> type[DirectIssue]:
        """A day of the past, and the regressions."""
        return DirectIssue

    def start(self, seed: int, outputs: Array, inputs: Array) -> DirectState:
        """Persistence, from the first sample: its outputs (n_y,) and inputs (n_u,)."""
        count, leads, width = len(self.network.measured), len(self._leads), self._width
        return DirectState(
            *self._begun(outputs, inputs),
            step=np.array(0, dtype=np.int64),
            moments=np.zeros((count, leads, width, width + 1)),
            coefficients=np.tile(self._prior, (2, count, 1, 1)),
            fitted=np.array(0, dtype=np.int64),
            verified=np.zeros((count, leads, 5)),
            seen=np.zeros((count, leads, 2)),
        )

    def restart(self, state: DirectState, outputs: Array, inputs: Array) -> DirectState:
        """The first sample after a gap: another past, the same regressions.

        Nobody tells how long the gap was, so what was learned of the hour is forgotten.
        """
        past, measured, held = self._begun(outputs, inputs)
        moments, coefficients = state.moments.copy(), state.coefficients.copy()
        moments[:, :, CLOCK], moments[:, :, :, CLOCK], coefficients[..., CLOCK] = 0.0, 0.0, 0.0
        return state._replace(outputs=past, measured=measured, inputs=held, moments=moments, coefficients=coefficients)

    def predict(self, state: DirectState, inputs: Array) -> DirectState:
        """One period on under `inputs` (n_u,) held over the step."""
        held, rows, known = _moved_on(
            state.inputs, inputs, state.outputs, state.measured, self._grid, int(state.step), state.coefficients[0],
            self._trust(state), state.seen,
        )  # fmt: skip
        return DirectState(rows, known, held, state.step + 1, *state[4:6], state.fitted + 1, *state[7:])

    def predictive(self, state: DirectState) -> Mixture:
        """A Gaussian for every output at the state's time, as a mixture of one."""
        sds = _spread(self._sds(state), self._leads, state.measured, 1)
        return Mixture(np.ones(1), state.outputs[:, -1:].copy(), sds)

    def update(self, state: DirectState, outputs: Array) -> Posterior:
        """Learn from `outputs` (n_y,), the newest of which `state` has forecast; NaN for a missing one."""
        measured = ~np.isnan(outputs)
        if not measured.any():
            return self._posterior(state, Outcome.MISSING)
        now = self.predictive(state)
        errors, sds = (outputs - now.means[:, 0])[measured], now.sds[measured, 0]
        if not (np.abs(errors) < FARTHEST + 10.0 * sds).all():
            return self._posterior(state, Outcome.VANISHED)
        past, known = state.outputs.copy(), state.measured.copy()
        past[measured, -1], known[measured, -1] = outputs[measured], 1.0
        moments, verified, seen = state.moments.copy(), state.verified.copy(), state.seen.copy()
        _learn(
            past, known, state.inputs, self._grid, int(state.step),
            (int(state.fitted), state.coefficients, self._trust(state)), (moments, verified, seen),
            (self._forgetting, self.verified_share(int(state.step))),
        )  # fmt: skip
        learned = DirectState(past, known, *state[2:4], moments, *state[5:7], verified, seen)
        if state.fitted >= self._day:
            fresh = fitted(moments, self._least, self.options.penalty_days * self._day, self._prior)
            coefficients = np.stack([fresh, state.coefficients[0]])
            learned = learned._replace(coefficients=coefficients, fitted=np.zeros_like(state.fitted))
        log_likelihood = float(-0.5 * ((errors / sds) ** 2).sum() - np.log(sds * np.sqrt(2.0 * np.pi)).sum())
        return self._posterior(learned, Outcome.ASSIMILATED, log_likelihood)

    def issue(self, state: DirectState, count: int) -> DirectIssue:
        """One forecast."""
        day = self._day
        return DirectIssue(
            outputs=state.outputs[:, -day - 2 :],
            measured=state.measured[:, -day - 2 :],
            inputs=state.inputs[-day - 1 :],
            step=state.step,
            coefficients=state.coefficients[0],
            trust=self._trust(state),
            sds=self._sds(state),
            seen=state.seen,
        )

    def unfold(self, issue: DirectIssue, plan: Array) -> Mixtures:
        """What the issue forecasts under `plan` (h, n_u)."""
        outputs, measured = np.ascontiguousarray(issue.outputs), np.ascontiguousarray(issue.measured)
        means = _unfolded(
            outputs, measured, np.concatenate([issue.inputs, plan]), len(plan) + 1, self._grid, int(issue.step),
            issue.coefficients, issue.trust, issue.seen,
        )  # fmt: skip
        return Mixtures.of_gaussians(means.T, _spread(issue.sds, self._leads, measured, len(plan) + 1).T)

    def verified_share(self, step: int) -> float:
        """What a step leaves of the sums over verified forecasts, `step` steps after the start: the first ones, of
        regressions that knew nothing, are soon forgotten."""
        return math.exp(-1.0 / min(self._verified_memory, self._day + step / 4.0))

    def _begun(self, outputs: Array, inputs: Array) -> tuple[Array, Array, Array]:
        """Outputs, what of them is measured, and inputs of two days in which nothing has changed."""
        past = np.tile(self.filled(outputs)[:, None], 2 * self._day + 1)
        measured = np.zeros_like(past)
        measured[:, -1] = np.isfinite(outputs)
        return past, measured, np.tile(inputs, (2 * self._day, 1))

    def _trust(self, state: DirectState) -> Array:
        """(n_y, L): what share of a foretold change has come true."""
        return trusts(state.verified, self._doubted, self._believed)

    def _sds(self, state: DirectState) -> Array:
        """(n_y, L): standard deviations [K] at the leads, from the errors of verified forecasts."""
        return _spreads(state.verified, self._presumed, self._growth, self._like)


@njit(cache=True, nogil=True)
def _unmeasured(measured):  # type: ignore[no-untyped-def]
    """(n_y,): for how many steps each output has not been measured; the newest is the one that is forecast."""
    late = np.empty(len(measured))
    for i in range(len(measured)):
        steps = 0
        while steps < measured.shape[1] and measured[i, measured.shape[1] - 1 - steps] == 0.0:
            steps += 1
        late[i] = steps - 1.0
    return late


@njit(cache=True, nogil=True)
def _first(measured):  # type: ignore[no-untyped-def]
    """(n_y,): place of the first value of each output that is measured; beyond the last where none is."""
    found = np.empty(len(measured), np.int64)
    for i in range(len(measured)):
        place = 0
        while place < measured.shape[1] and measured[i, place] == 0.0:
            place += 1
        found[i] = place
    return found


@njit(cache=True, nogil=True)
def _moved_on(inputs, newest, outputs, measured, grid, step, coefficients, trust, seen):  # type: ignore[no-untyped-def]
    """Inputs with the `newest` (n_u,), outputs with what is foretold at the first lead, and that it is not measured."""
    held, rows, known = np.empty_like(inputs), np.empty_like(outputs), np.empty_like(measured)
    held[:-1], held[-1] = inputs[1:], newest
    rows[:, :-1], rows[:, -1] = outputs[:, 1:], outputs[:, -1]
    known[:, :-1], known[:, -1] = measured[:, 1:], 0.0
    sums, first, origin = _sums(held, grid), _first(known), 2 * grid.day - 1
    rows[:, -1] += _foretold(rows, first, sums, grid, step, origin, coefficients, trust, seen, 1)[:, 0]
    return held, rows, known


@njit(cache=True, nogil=True)
def _sums(inputs, grid):  # type: ignore[no-untyped-def]
    """(m + 1, n_u): sums of the first rows of scaled `inputs` (m, n_u)."""
    found = np.zeros((len(inputs) + 1, len(grid.level)))
    for k in range(len(inputs)):
        for j in range(len(grid.level)):
            found[k + 1, j] = found[k, j] + (inputs[k, j] - grid.level[j]) / grid.scale[j]
    return found


@njit(cache=True, nogil=True)
def _spread(sds, leads, measured, count):  # type: ignore[no-untyped-def]
    """(n_y, count): `sds` (n_y, L) [K] at the first forecast and the steps after it, by what was `measured` last.

    Beyond the last lead they grow with the root of the time.
    """
    found, late = np.empty((len(sds), count)), _unmeasured(measured)
    for i in range(len(sds)):
        begin, n = 1.0 + max(late[i], 0.0), 0
        for k in range(count):
            steps = begin + k
            while n < len(leads) - 2 and leads[n + 1] <= steps:
                n += 1
            if steps >= leads[-1] or len(leads) == 1:
                sd = sds[i, -1]
            else:
                slope = (sds[i, n + 1] - sds[i, n]) / (leads[n + 1] - leads[n])
                sd = slope * (steps - leads[n]) + sds[i, n]
            found[i, k] = sd * math.sqrt(max(steps / leads[-1], 1.0))
    return found


@njit(cache=True, nogil=True)
def _spreads(verified, presumed, growth, like):  # type: ignore[no-untyped-def]
    """(n_y, L): standard deviations [K] of forecasts from what was `verified` of them."""
    found, variances = np.empty(verified.shape[:2]), np.empty(len(growth))
    for i in range(len(verified)):
        for n in range(len(growth)):
            number, squares = verified[i, n, 0], verified[i, n, 4]
            expected = growth[n] * (variances[like[n]] if n > 0 else _HOUR_SD * _HOUR_SD)
            variances[n] = (presumed[n] * expected + squares) / (presumed[n] + number)
            found[i, n] = max(math.sqrt(variances[n]), _LEAST_SD)
    return found


@njit(cache=True, nogil=True)
def _row(outputs, first, sums, origin, lead, grid, step, row):  # type: ignore[no-untyped-def]
    """Regressors (p,) of a forecast `lead` steps ahead of the sample at the place `origin`, number `step`, in place.

    Before the place `first` nothing is known. `sums` (m + 1, n_u) are those of the inputs before each place: that of
    place k is held from sample k to the next.
    """
    windows, own, target = grid.windows, outputs[origin], origin + lead
    row[0] = 1.0
    row[1] = own - LEVEL
    row[2] = own - outputs[max(origin - 1, 0)]
    row[3] = own - outputs[max(origin - windows[5], 0)]
    row[4] = own - outputs[max(origin - windows[6], 0)]
    before = max(min(target - grid.day, origin), 0)
    row[5] = outputs[before] - own if before >= first else 0.0
    angle = 2.0 * np.pi * ((step + lead) % grid.day) / grid.day
    row[6], row[7] = np.sin(angle), np.cos(angle)
    place = 8
    for j in range(sums.shape[1]):
        if grid.foresees:
            row[place] = (sums[target, j] - sums[origin, j]) / lead
            place += 1
        for w in range(3):
            begin = max(origin - windows[w], 0)
            row[place] = (sums[origin, j] - sums[begin, j]) / max(origin - begin, 1)
            place += 1
        for w in range(2 if grid.foresees else 0):
            begin = max(target - windows[3 + w], origin)
            row[place] = (sums[target, j] - sums[begin, j]) / (target - begin)
            place += 1


@njit(cache=True, nogil=True)
def _change(row, coefficients, lowest, highest):  # type: ignore[no-untyped-def]
    change = np.sum(row * coefficients)
    return min(max(change, lowest), highest)


@njit(cache=True, nogil=True)
def _foretold(outputs, first, sums, grid, step, origin, coefficients, trust, seen, count):  # type: ignore[no-untyped-def]
    """Changes (n_y, count) [K] at the first leads after the sample at the place `origin`, number `step`; before the
    places `first` (n_y,) nothing is known of `outputs`."""
    row, changes = np.empty(coefficients.shape[2]), np.empty((outputs.shape[0], count))
    for i in range(outputs.shape[0]):
        for n in range(count):
            _row(outputs[i], first[i], sums, origin, grid.leads[n], grid, step, row)
            changes[i, n] = trust[i, n] * _change(row, coefficients[i, n], seen[i, n, 0], seen[i, n, 1])
    return changes


@njit(cache=True, nogil=True)
def _unfolded(past, measured, inputs, steps, grid, step, coefficients, trust, seen):  # type: ignore[no-untyped-def]
    """Outputs (n_y, steps) from a forecast of the newest of `past` (n_y, day + 2) on. `inputs` (m, n_u) begin a day
    before the last sample."""
    # The lead after the last one that is asked for may need inputs beyond.
    day, needed = grid.day, grid.leads[: np.searchsorted(grid.leads, steps) + 1]
    held = np.empty((len(inputs) + day, inputs.shape[1]))
    held[: len(inputs)], held[len(inputs) :] = inputs, inputs[-1]
    sums, first = _sums(held, grid), _first(measured)
    outputs = np.zeros((len(past), day + 1 + steps + day))
    outputs[:, : day + 1] = past[:, :-1]
    for last in range(day, day + steps, day):
        now = step + last - day - 1
        changes = _foretold(outputs, first, sums, grid, now, last, coefficients, trust, seen, len(needed))
        for i in range(len(past)):
            begin, change, n = 0, 0.0, 0
            for ahead in range(1, day + 1):
                if n < len(needed) and needed[n] <= ahead:
                    begin, change, n = needed[n], changes[i, n], n + 1
                slope = (changes[i, n] - change) / (needed[n] - begin) if n < len(needed) else 0.0
                outputs[i, last + ahead] = outputs[i, last] + (slope * (ahead - begin) + change)
    outputs[:, day + 1] = past[:, -1]
    return outputs[:, day + 1 : day + 1 + steps].copy()


@njit(cache=True, nogil=True)
def _learn(outputs, measured, inputs, grid, step, known, learned, memory):  # type: ignore[no-untyped-def]
    """Verify what could be forecast for the newest sample, number `step`, and add it to what is `learned`, in place:
    moments, verified and seen. `known` are the steps since the fit, the coefficients and the trust; `memory` is what a
    step leaves of moments and of verified forecasts."""
    fitted, coefficients, trust = known
    moments, verified, seen = learned
    forgetting, kept = memory
    leads, sums, target = grid.leads, _sums(inputs, grid), outputs.shape[1] - 1
    row, first = np.empty(coefficients.shape[3]), _first(measured)
    for i in range(outputs.shape[0]):
        for n in range(len(leads)):
            origin = target - leads[n]
            if measured[i, target] == 0.0 or measured[i, origin] == 0.0:
                continue
            _row(outputs[i], first[i], sums, origin, leads[n], grid, step - leads[n], row)
            real = outputs[i, target] - outputs[i, origin]
            # With the coefficients that were in force when the forecast would have been made.
            then = coefficients[0 if leads[n] <= fitted else 1, i, n]
            change = _change(row, then, seen[i, n, 0], seen[i, n, 1])
            error = real - trust[i, n] * change
            for m in range(5):
                verified[i, n, m] *= kept
            verified[i, n, 0] += 1.0
            verified[i, n, 1] += change * real
            verified[i, n, 2] += change * change
            verified[i, n, 3] += real * real
            verified[i, n, 4] += error * error
            seen[i, n, 0], seen[i, n, 1] = min(seen[i, n, 0], real), max(seen[i, n, 1], real)
            for a in range(len(row)):
                for b in range(len(row)):
                    moments[i, n, a, b] = forgetting * moments[i, n, a, b] + row[a] * row[b]
                moments[i, n, a, len(row)] = forgetting * moments[i, n, a, len(row)] + row[a] * real
