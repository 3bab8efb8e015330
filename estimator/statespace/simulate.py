"""Simulation of an estimator's draws under a plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np

from estimator.arrays import Array
from estimator.kernels.draws import Draws, Purpose
from estimator.statespace.matrices import StateSpace, of_draws
from estimator.types import ModelDraws


class Room(Protocol):
    """What is simulated step by step."""

    def outputs(self) -> Array:
        """(n_y,): mean of the outputs now [degC]."""

    def step(self, inputs: Array) -> None:
        """One step on under `inputs` (n_u,)."""

    def anew(self) -> Room:
        """The same at its beginning."""


Driving = Callable[[int, Array], Array]
"""The drive row (n_u + m,) of a step of a simulation, by its number from 0, under inputs (n_u,)."""


class Simulation:
    """The draws of one zone, moved step by step; their mean is the zone's forecast as far as its physics go."""

    def __init__(self, models: StateSpace, driving: Driving | None = None) -> None:
        """`driving` is needed where the network of the models has terms."""
        self._models, self._driving = models, driving
        self._state, self._step = models.state, 0

    def outputs(self) -> Array:
        """(n_y,): mean of the outputs now [degC]."""
        each = self._state @ self._models.c.T
        return np.asarray((each * self._models.weights[:, None]).sum(axis=0), dtype=np.float64)

    def step(self, inputs: Array) -> None:
        """One step on under `inputs` (n_u,)."""
        row = inputs if self._driving is None else self._driving(self._step, inputs)
        self._state = np.einsum("kij,kj->ki", self._models.a, self._state) + self._models.b @ row
        self._step += 1

    def anew(self) -> Simulation:
        """The same draws at their beginning."""
        return Simulation(self._models, self._driving)


def gain_forecast(models: StateSpace, steps: int) -> Array:
    """(2, steps): mean and standard deviation over the draws of the gain [W] at the beginning of each step, as far as a
    gain that is on now lasts; (2, 0) without a gain."""
    states = len(models.network.nodes)
    if models.state.shape[1] == states:
        return np.empty((2, 0))
    gain, decay, path = models.state[:, states], models.a[:, states, states], []
    for _ in range(steps):
        mean = float((models.weights * gain).sum())
        path.append((mean, float(np.sqrt((models.weights * (gain - mean) ** 2).sum()))))
        gain = gain * decay
    return np.array(path).T


def sampled_paths(draws: ModelDraws, period: float, plan: Array, seed: int, origin: int) -> Array:
    """One future (K, h + 1, n_y) [degC] of each draw under `plan` (h, n_u), without measurement noise.

    Each starts at a draw of its state and has its own process noise; a gain that is on may end, none begins, and the
    volatility stays as it is. `seed` and `origin`, the number of the step now, are all that the random numbers depend
    on.
    """
    models = of_draws(draws, period, 1)
    size, count = draws.state.shape
    states = len(models.network.nodes)
    now = Draws(seed, origin, forecast=True)
    state = (draws.state + draws.spread * now.normals(Purpose.MIXTURE_SAMPLE, (size, count))).T
    roots = np.sqrt(draws.process_variance).T
    # The matrices hold the chance that a gain stays on; here it does, or does not.
    alive, stays = np.ones((count, size - states)), draws.gain_stays
    transition = models.a.copy()
    transition[:, :, states:] /= stays or 1.0
    path = [state @ models.c.T]
    for ahead, inputs in enumerate(plan, start=1):
        step = Draws(seed, origin + ahead, forecast=True)
        lasting = stays > step.uniforms(Purpose.SCENARIO_SWITCH, (size - states, count)).T
        alive = alive * lasting
        state[:, states:] *= alive
        noise = roots * step.normals(Purpose.SCENARIO, (size, count)).T
        noise[:, states:] *= alive
        state = np.einsum("kij,kj->ki", transition, state) + models.b @ inputs + noise
        path.append(state @ models.c.T)
    return np.array(path).transpose(1, 0, 2)


Neighbours = Mapping[int, tuple[int, int]]
"""Which inputs of a room are outputs of other rooms: input to (room, output)."""


def coupled_paths(rooms: Sequence[Room], plans: Sequence[Array], neighbours: Sequence[Neighbours]) -> list[Array]:
    """Plans (h, n_u) of rooms of one step and one beginning, simulated together: in each, the inputs that are
    `neighbours` hold the mean of the other room's output at the same time. The rooms' simulations are moved."""
    filled = [plan.copy() for plan in plans]
    for ahead in range(len(filled[0]) if filled else 0):
        outputs = [room.outputs() for room in rooms]
        for plan, others in zip(filled, neighbours, strict=True):
            for place, (other, output) in others.items():
                plan[ahead, place] = outputs[other][output]
        for room, plan in zip(rooms, filled, strict=True):
            room.step(plan[ahead])
    return filled
