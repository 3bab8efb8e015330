"""Perfect knowledge: the same programme, planned against the plant itself, which lives a period again and again. Each
pass plans with what the pass before it really did, corrected for what it heats otherwise, by the response to heat
pulses that is measured on the plant. What that misses, because a building is not quite linear, the next pass knows."""

import numpy as np
from scipy.linalg import toeplitz

from estimator.arrays import Array
from replay.lab.experiments.control.cases import OFF, WARMEST, Scene, price, steps_with
from replay.lab.experiments.control.controllers import DECISION, EVERY, HORIZON, Thermostat, by_plan_step, lowest
from replay.lab.experiments.control.customer import mpc
from replay.lab.experiments.control.loop import Controller, Lived, Moment, close
from replay.localtime import HOUR
from replay.scores.intervals import Mask

PASSES = 3
_PULSE = 0.15
"""Of a heater's power."""
_AHEAD = round(HORIZON / DECISION)
_REMEMBERED = 4 * _AHEAD
"""Steps of a plan after which a pulse is forgotten."""


class Replayed(Controller):
    """Heats as in an earlier life, and `extra` (K, N) W more."""

    def __init__(self, before: Lived, extra: Array) -> None:
        self._heating = before.heating + extra

    def powers(self, moment: Moment) -> tuple[Array, Mask]:
        powers = self._heating[moment.step]
        return powers, np.ones(len(powers), dtype=np.bool_)


def responses(scene: Scene, before: Lived) -> Array:
    """(N, N, L): K of each room (first) at the end of each step of a plan after one W in a room (second) over the
    first. Measured on the plant by pulses on top of the life `before`, one every _REMEMBERED steps of a plan."""
    rooms = len(scene.of.rooms)
    apart = _REMEMBERED * EVERY
    starts = np.arange(0, scene.steps - apart, apart) + EVERY
    if not len(starts):
        starts = np.array([0])
    starts = starts[~steps_with(OFF, scene)[starts]]
    kelvin = np.zeros((rooms, rooms, _REMEMBERED))
    # A heater at its limit could not give a pulse.
    free = np.minimum(before.heating, [(1.0 - _PULSE) * room.heater for room in scene.of.rooms])
    base = close(scene, Replayed(before._replace(heating=free), np.zeros_like(free)))
    for room, one in enumerate(scene.of.rooms):
        extra = np.zeros_like(free)
        for start in starts:
            extra[start : start + EVERY, room] = _PULSE * one.heater
        moved = (close(scene, Replayed(base, extra)).air - base.air) / (_PULSE * one.heater)
        seen = [moved[start + EVERY : start + apart + 1 : EVERY] for start in starts]
        length = min(map(len, seen))
        kelvin[:, room, :length] = np.mean([each[:length] for each in seen], axis=0).T
    return kelvin


class Foreseeing(Controller):
    """Plans all rooms together from the life `before`, by the same costs, horizon, step and limits as `mpc.py`."""

    def __init__(self, scene: Scene, before: Lived, kelvin: Array, margin: float) -> None:
        self._scene, self._before, self._margin = scene, before, margin
        self._kelvin, self._life = kelvin, scene.life()
        self._thermostat = Thermostat(scene, margin)
        rooms = len(scene.of.rooms)
        rated = np.array([room.heater for room in scene.of.rooms])
        self._most = rated[:, None] * ~steps_with(OFF, scene)[::EVERY]
        """What the heaters can give (N, K / EVERY) [W]."""
        self._planned_before = by_plan_step(before.heating)
        self._extra = np.zeros((len(self._planned_before), rooms))
        """What was heated otherwise than before, by the steps of a plan [W]."""
        self._heating = np.zeros(rooms)
        first = self._kelvin[:, :, :_AHEAD]
        self._moved = np.block([[toeplitz(first[i, j], np.zeros(_AHEAD)) for j in range(rooms)] for i in range(rooms)])

    def powers(self, moment: Moment) -> tuple[Array, Mask]:
        begins = self._scene.controlled_from
        if moment.step < begins:
            return self._thermostat.powers(moment)
        if (moment.step - begins) % EVERY == 0:
            self._plan(moment)
        return self._heating, np.ones(len(self._heating), dtype=np.bool_)

    def saw(self, moment: Moment, heating: Array, outdoor: float, irradiance: float) -> None:
        self._extra[moment.step // EVERY] += (heating - self._before.heating[moment.step]) / EVERY

    def _plan(self, moment: Moment) -> None:
        now, rooms = moment.step // EVERY, len(self._most)
        ahead = min(_AHEAD, len(self._before.air[moment.step :: EVERY]) - 1)
        if ahead < 1:
            return
        was = self._before.air[moment.step :: EVERY][1 : ahead + 1].T
        change = self._extra[max(0, now - _REMEMBERED) : now]
        # Without heating from now on, and with what is heated otherwise until now.
        extra = np.concatenate([change, -self._planned_before[now : now + ahead]])
        free = was + self._response_to(extra, len(change), ahead)
        low = np.array([lowest(self._life, moment.local, room, ahead, self._margin) for room in range(rooms)])
        prices = np.array([price(moment.local + (k + 0.5) * DECISION) for k in range(ahead)])
        take = np.concatenate([np.arange(ahead) + room * _AHEAD for room in range(rooms)])
        moved = self._moved[np.ix_(take, take)]
        self._heating = planned(moved, free.ravel(), low.ravel(), prices, self._most[:, now : now + ahead])[:, 0]

    def _response_to(self, extra: Array, past: int, ahead: int) -> Array:
        """(N, ahead): K at the ends of the steps to come, of `extra` (past + ahead, N) W."""
        rooms = len(self._most)
        moved = np.zeros((rooms, past + ahead))
        for i in range(rooms):
            for j in range(rooms):
                moved[i] += np.convolve(extra[:, j], self._kelvin[i, j])[: past + ahead]
        return moved[:, past:]


def planned(moved: Array, free: Array, low: Array, prices: Array, most: Array) -> Array:
    """(N, n): the powers [W] of least cost for N rooms together, by `mpc.plan`. `moved` (N n, N n) is what a W in each
    room and step (column) does to each room after each step (row) [K]; `free` and `low` (N n,) [degC], room after room;
    `most` (N, n) is what the heaters can give [W]."""
    high, costs = np.full(len(free), WARMEST), np.tile(prices, len(most))
    powers = mpc().plan(moved, free, low, high, costs, most.ravel(), DECISION / HOUR)
    return np.asarray(powers, dtype=np.float64).reshape(most.shape)


def foreseen(scene: Scene, margin: float) -> Lived:
    """The life of `scene` under perfect knowledge: the last of PASSES passes."""
    lived = close(scene, Thermostat(scene, margin))
    response = responses(scene, lived)
    for _ in range(PASSES):
        lived = close(scene, Foreseeing(scene, lived, response, margin))
    return lived
