"""The thermostat inside the simulation: every draw's own temperature calls for its own heat.

At each step, with the set-point r_k and the temperature T_k of a draw,

    x_(k+1) = A x_k + B u_k + w_k,    w_k ~ N(0, Q),
    u_k = law(r_k - T_(k+1)) where it is proportional,    law(r_k - T_k, u_(k-1)) where it is on-off,

so that a forecast stays within what the thermostat allows, and a model's own errors are corrected as the real
thermostat corrects them. The proportional law looks at the end of the step: a real one acts all the time, and one that
looked at the beginning would overshoot where its band is narrow and the step long. Heat of a step without a set-point
is that of the plan.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from estimator.arrays import Array, Indices
from estimator.foresight import Astray
from estimator.kernels.draws import Draws, Purpose
from estimator.statespace.matrices import StateSpace, of_draws
from estimator.statespace.simulate import Driving, Simulation
from estimator.thermostat.law import Laws, called
from estimator.types import Mixtures, ModelDraws


class Paths(NamedTuple):
    """K futures of h steps."""

    weights: Array
    """(K,): they add up to 1."""
    temperatures: Array
    """(K, h + 1, n_y): now and after each step, without measurement noise [degC]."""
    heat: Array
    """(K, h, L): what each law's input was over each step, in its unit."""
    variance: Array
    """(K, n_y): of the measurement noise [K^2]."""
    weather: Indices
    """(K,): as `estimator.foresight.Astray` has it; -1 where it is what is foreseen."""

    def on(self, after: Indices, laws: Laws, steps: int) -> Array:
        """(L, K, n_laws): share of the `steps` before each of `after` (L,) in which a law gave most of its power."""
        most = np.abs(self.heat) > 0.5 * laws.numbers[:, 0]
        return np.array([most[:, max(end - steps, 0) : end].mean(axis=1) for end in after.tolist()])

    def mixtures(self, after: Indices) -> Mixtures:
        """The measured outputs `after` (L,) steps."""
        means = self.temperatures[:, after].transpose(1, 2, 0)
        sds = np.broadcast_to(np.sqrt(self.variance.T), means.shape)
        return Mixtures(np.tile(self.weights, (len(means), 1)), means, sds.copy())


class Course(NamedTuple):
    """K models on their way over h steps, all but ready to run: what differs between two futures is what was asked."""

    models: StateSpace
    laws: Laws
    response: Array
    """(K, n_x, L): to what each law calls for, per unit."""
    idle: Array
    """(K, h, n_x): what every other input brings over a step."""
    planned: Array
    """(h, L): what each law's input is where there is no set-point."""
    first: Array
    """(L,): what each law's input was over the step before."""
    process: Array
    """(h, n_x + G, K): added to the state [K, W] after each step."""
    alive: Array
    """(h, G, K): whether a gain that is on at the beginning still lasts, 0 or 1."""
    numbers: Array
    """(L, 3, K): the laws' in each draw."""
    weather: Indices
    """(K,): as `Paths` has it."""

    def under(self, setpoints: Array) -> Paths:
        """The futures in which the laws keep the `setpoints` (h,) [degC], NaN where nobody sets one."""
        models, count, steps = self.models, len(self.models.state), len(setpoints)
        temperatures = np.empty((count, steps + 1, len(models.c)))
        heat = np.empty((count, steps, len(self.first)))
        _run(
            models.a,
            self.response,
            self.idle,
            models.state.copy(),
            len(models.network.nodes),
            np.argmax(models.c, axis=1),
            setpoints,
            self.planned,
            self.first,
            self.laws.side,
            self.laws.switching,
            self.numbers,
            self.process,
            self.alive,
            temperatures,
            heat,
        )
        variance = np.diagonal(models.r, axis1=1, axis2=2).copy()
        return Paths(models.weights, temperatures, heat * self.laws.sign, variance, self.weather)


def course_of(
    draws: ModelDraws,
    period: float,
    laws: Laws,
    rows: Array,
    before: Array,
    *,
    seed: int,
    origin: int,
    astray: Astray | None = None,
) -> Course:
    """The futures of `draws` over `rows` (h, n_u), the inputs of every step, with noise as `sampled_paths` has it and
    numbers of the `laws` drawn from what is known of them. Inputs that obey a law hold what is planned where there is
    no set-point.

    Args:
        before: (n_u,): inputs of the step before, from which on-off laws know whether they are on.
        seed: with `origin`, the number of the step now, all that the random numbers depend on.
        astray: by how much the inputs of each draw differ from `rows`; by default they do not.
    """
    steps, places = len(rows), laws.column.astype(np.int64)
    models = of_draws(draws, period, 1)
    size, count = draws.state.shape
    states = len(models.network.nodes)
    now = Draws(seed, origin, forecast=True)
    start = (draws.state + draws.spread * now.normals(Purpose.MIXTURE_SAMPLE, (size, count))).T
    normals = now.normals(Purpose.SCENARIO, (steps * size, count)).reshape(steps, size, count)
    process = np.sqrt(draws.process_variance) * normals
    lasting = draws.gain_stays > now.uniforms(Purpose.SCENARIO_SWITCH, (steps * (size - states), count))
    alive = np.cumprod(lasting.reshape(steps, size - states, count), axis=0).astype(np.float64)
    process[:, states:] *= alive
    # The matrices hold the chance that a gain stays on; here it does, or does not.
    transition = models.a.copy()
    transition[:, :, states:] /= draws.gain_stays or 1.0
    return Course(
        models._replace(a=transition, state=start),
        laws,
        np.ascontiguousarray(models.b[:, :, places]) * laws.sign,
        _idle(models, places, rows, astray),
        laws.sign * rows[:, places],
        np.maximum(laws.sign * before[places], 0.0),
        process,
        alive,
        _drawn(laws, now, count),
        np.full(count, -1) if astray is None else astray.weather,
    )


def _idle(models: StateSpace, places: Indices, rows: Array, astray: Astray | None) -> Array:
    """(K, h, n_x): what `rows` (h, n_u) and how far they stray bring over a step, but for the inputs at `places`."""
    others = rows.copy()
    others[:, places] = 0.0
    idle = _driven(models.b, others)
    if astray is not None:
        for column, shift in astray.shifts:
            idle += shift[:, :, None] * models.b[:, None, :, column]
        if len(astray.sunny):
            idle += astray.sun[:, :, None] * _driven(models.b[:, :, astray.sunny], rows[:, astray.sunny])
    return np.ascontiguousarray(idle)


def _driven(response: Array, rows: Array) -> Array:
    """(K, h, n): what `rows` (h, m) bring to each draw by its `response` (K, n, m)."""
    count, size, width = response.shape
    return (response.reshape(count * size, width) @ rows.T).reshape(count, size, len(rows)).transpose(0, 2, 1)


class LawRoom(Simulation):
    """A room whose thermostat keeps `setpoints` (h,) [degC] while it is simulated step by step with its neighbours; see
    `estimator.statespace.simulate.Room`. Beyond their end the last set-point stays."""

    def __init__(
        self, models: StateSpace, laws: Laws, setpoints: Array, before: Array, driving: Driving | None = None
    ) -> None:
        """`before` (n_u,) are the inputs of the step before the first; `driving` is needed where the network of the
        models has terms."""
        super().__init__(models, driving)
        self._laws, self._setpoints, self._before = laws, setpoints, before
        self._places = laws.column.astype(np.int64)
        first = np.maximum(laws.sign * before[self._places], 0.0)
        self._heat = np.repeat(first[:, None], len(models.state), axis=1)

    def step(self, inputs: Array) -> None:
        """One step on under `inputs` (n_u,), of which those that obey a law hold only where no set-point is known."""
        setpoint = self._setpoints[min(self._step, len(self._setpoints) - 1)]
        if np.isnan(setpoint):
            return super().step(inputs)
        free = inputs.copy()
        free[self._places] = 0.0
        measured, before = self._models.c[0], self._state
        super().step(free)
        for i in range(len(self._places)):
            now, later = (setpoint - state @ measured for state in (before, self._state))
            effect = self._models.b[:, :, self._places[i]] * self._laws.sign[i]
            self._heat[i] = called(self._laws, i, now, later, effect @ measured, self._heat[i])
            self._state = self._state + effect * self._heat[i][:, None]
        return None

    def anew(self) -> LawRoom:
        """The same at its beginning."""
        return LawRoom(self._models, self._laws, self._setpoints, self._before, self._driving)


def _drawn(laws: Laws, now: Draws, count: int) -> Array:
    """(L, 3, K): numbers of the laws, in bounds that keep a law one: power and band at least a tenth of the mean."""
    normals = now.normals(Purpose.LAW, (3 * len(laws.column), count)).reshape(-1, 3, count)
    roots = [np.linalg.cholesky(covariance) for covariance in laws.covariance]
    numbers = np.array([mean[:, None] + root @ z for mean, root, z in zip(laws.numbers, roots, normals, strict=True)])
    numbers = numbers.reshape(-1, 3, count)
    numbers[:, 0] = np.maximum(numbers[:, 0], 0.1 * laws.numbers[:, :1])
    numbers[:, 2] = np.maximum(numbers[:, 2], 0.1 * laws.numbers[:, 2:])
    return numbers


@njit(cache=True, nogil=True)
def _run(  # type: ignore[no-untyped-def]
    a, response, idle, state, nodes, measured, setpoints, planned, before, side, switching, numbers, process, alive,
    temperatures, heat,
):  # fmt: skip
    count, size = state.shape
    steps, laws = planned.shape
    later, last = np.empty(size), np.empty(laws)
    for k in range(count):
        for i in range(laws):
            last[i] = before[i]
        x = state[k]
        for y in range(len(measured)):
            temperatures[k, 0, y] = x[measured[y]]
        for h in range(steps):
            for g in range(size - nodes):
                x[nodes + g] *= alive[h, g, k]
            for i in range(size):
                value = idle[k, h, i] + process[h, i, k]
                for j in range(size):
                    value += a[k, i, j] * x[j]
                later[i] = value
            for i in range(laws):
                power, offset, band = numbers[i, 0, k], numbers[i, 1, k], numbers[i, 2, k]
                if setpoints[h] != setpoints[h]:
                    last[i] = max(planned[h, i], 0.0)
                    heat[k, h, i] = last[i]
                    for j in range(size):
                        later[j] += response[k, j, i] * planned[h, i]
                    continue
                if switching[i] > 0.5:
                    deviation = side[i] * (setpoints[h] - x[measured[0]])
                    on = deviation > offset + (-0.5 if last[i] > 0.5 * power else 0.5) * band
                    given = power if on else 0.0
                else:
                    share = (side[i] * (setpoints[h] - later[measured[0]]) - offset) / band + 0.5
                    effect = max(side[i] * response[k, measured[0], i], 0.0)
                    given = power * min(max(share / (1.0 + effect * power / band), 0.0), 1.0)
                last[i] = given
                heat[k, h, i] = given
                for j in range(size):
                    later[j] += response[k, j, i] * given
            for i in range(size):
                x[i] = later[i]
            for y in range(len(measured)):
                temperatures[k, h + 1, y] = x[measured[y]]
