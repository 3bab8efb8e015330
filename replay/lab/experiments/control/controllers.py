"""Who heats: a thermostat with night setback, and planners over Thermogate's REST."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from estimator.arrays import Array
from replay.energyplus.plant import STEP
from replay.lab.experiments.control.cases import STUCK, WARMEST, Scene, price, steps_with
from replay.lab.experiments.control.customer import mpc
from replay.lab.experiments.control.loop import Controller, Moment
from replay.lab.experiments.control.site import HEATER, Site, inputs_of, networks_of
from replay.localtime import HOUR
from replay.scores.intervals import Mask
from service.records.sample import Sample

DECISION = 1800.0
"""s between two decisions, and the step of a plan."""
HORIZON = 86400.0
EVERY = round(DECISION / STEP)
EARLY = HOUR
"""s by which a thermostat is set up before a night setback ends, as its owner would."""
_STUCK_AFTER = round(HOUR / 2 / STEP)
"""Steps after which the source of a zone refuses a reading that has not changed (`stuck_after` = "15min": uncertain
from then on, bad after twice as long)."""


class Thermostat(Controller):
    """A relay for each room at the lower end of the band and `margin` K, `early` s before a setback ends."""

    def __init__(self, scene: Scene, margin: float = 0.0, early: float = EARLY) -> None:
        self._life, self._early = scene.life(), early
        self._settings = [settings_of(scene, index, margin) for index in range(len(scene.of.rooms))]
        self._margin = margin
        self._heating = np.zeros(len(self._settings))

    def powers(self, moment: Moment) -> tuple[Array, Mask]:
        now, soon = (self._life.set_points(at) for at in (moment.local, moment.local + self._early))
        wanted = np.maximum(now, soon) + self._margin
        self._heating = np.array(
            [
                mpc().thermostat(settings, shown, heating > 0.0, low)
                for settings, shown, heating, low in zip(
                    self._settings, moment.shown, self._heating, wanted, strict=True
                )
            ]
        )
        return self._heating, np.zeros(len(wanted), dtype=np.bool_)


MakeSite = Callable[[Mapping[str, Sequence[Sample]]], Site]
"""Thermogate for a building, from the samples of every room so far, which it has not yet taken."""


class Planner(Controller):
    """Every room is heated by the example `mpc.py` over Thermogate's REST, and by its thermostat between decisions and
    until step `begins`. Who plans is given the weather as it will be, and what the other rooms have last planned: what
    is compared is the model of the building."""

    def __init__(
        self, scene: Scene, make_site: MakeSite, weather: tuple[Array, Array], *, begins: int, trusting: bool
    ) -> None:
        """`weather` (outdoor and irradiance of every step and a day more); `trusting` takes every forecast for good."""
        self._building = scene.of
        self._rooms = [room.name for room in scene.of.rooms]
        self._beside = [[self._rooms[other] for other in scene.of.neighbours(i)] for i in range(len(self._rooms))]
        self._life, self._networks = scene.life(), networks_of(scene.of)
        self._settings = [settings_of(scene, index) for index in range(len(self._rooms))]
        self._make_site, self._weather, self._begins, self._trusting = make_site, weather, begins, trusting
        self._thermostat = Thermostat(scene)
        self._stuck = steps_with(STUCK, scene)
        self._site: Site | None = None
        self._samples: dict[str, list[Sample]] = {room: [] for room in self._rooms}
        self._heating = np.zeros(len(self._rooms))
        self._memories = [mpc().Memory(settings) for settings in self._settings]
        self._decisions: list[Any] = [None] * len(self._rooms)
        """The last one of each room; None where it leaves the room to the plant's own thermostat."""
        self._planned: dict[str, tuple[int, Array]] = {}
        """By room: the step at which it was last planned, and the powers."""
        self._unchanged = 0

    def powers(self, moment: Moment) -> tuple[Array, Mask]:
        powers = self._thermostat.powers(moment)[0].copy()
        by_plan = np.zeros(len(self._rooms), dtype=np.bool_)
        if moment.step < self._begins:
            return powers, by_plan
        due = (moment.step - self._begins) % EVERY == 0
        if due:
            self._feed()
        for index, settings in enumerate(self._settings):
            if due or self._refused(index, moment.step):
                self._decisions[index] = self._decision(index, moment)
            decision = self._decisions[index]
            if decision is not None and decision.by != "thermostat":
                by_plan[index] = True
                powers[index] = decision.power
            if decision is not None and decision.by == "plan":
                powers[index] = mpc().held(settings, decision, moment.time, moment.shown[index])
        self._heating = powers
        return powers, by_plan

    def saw(self, moment: Moment, heating: Array, outdoor: float, irradiance: float) -> None:
        known = moment.shown.copy()
        known[[self._refused(index, moment.step) for index in range(len(known))]] = np.nan
        for index, room in enumerate(self._rooms):
            if moment.step >= self._begins:
                self._memories[index].heated(moment.time, heating[index], not np.isnan(known[index]))
            inputs = inputs_of(self._building, index, self._networks[room], known, outdoor, irradiance, heating)
            self._samples[room].append(Sample.measured(moment.time, known[index : index + 1], inputs))
        self._unchanged = self._unchanged + 1 if self._stuck[moment.step] else 0

    def _refused(self, room: int, step: int) -> bool:
        """Whether the source refuses what the thermometer of a room shows in `step`."""
        return room == 0 and bool(self._stuck[step]) and self._unchanged >= _STUCK_AFTER

    def _feed(self) -> None:
        if self._site is None:
            self._site = self._make_site(self._samples)
        self._site.feed(self._samples)
        self._samples = {room: [] for room in self._rooms}

    def _decision(self, room: int, moment: Moment) -> Any:
        memory = self._memories[room]
        if self._refused(room, moment.step):
            try:
                return memory.blind(moment.time)
            except ValueError:
                return None
        decision = mpc().decide(
            self._ask,
            self._settings[room],
            float(moment.shown[room]),
            bool(self._heating[room] > 0.0),
            lambda steps: [price(moment.local + (k + 0.5) * DECISION) for k in range(steps)],
            lambda steps: lowest(self._life, moment.local, room, steps),
            lambda steps: self._known(moment.step, room, steps),
            memory.left(moment.time),
        )
        if decision.by == "plan":
            memory.planned(moment.time, decision.plan)
            self._planned[self._rooms[room]] = (moment.step, decision.plan)
        return decision

    def _ask(self, method: str, path: str, body: Any) -> Any:
        assert self._site is not None
        answer = self._site.ask(method, path, body)
        if self._trusting and path.endswith("/trust"):
            answer["horizons"] = [one | {"trust": "trusted", "planned": "trusted"} for one in answer["horizons"]]
        return answer

    def _known(self, index: int, room: int, steps: int) -> dict[str, dict[str, list[float]]]:
        """The weather of all rooms, and what the others have planned."""
        ahead = slice(index, index + steps * EVERY)
        outdoor, sun = (by_plan_step(series[ahead]).tolist() for series in self._weather)
        known = {name: {"T_out": outdoor, "I_sol": sun} for name in (self._rooms[room], *self._beside[room])}
        for other in self._beside[room]:
            decision = self._decisions[self._rooms.index(other)]
            if other in self._planned and decision is not None and decision.by != "thermostat":
                planned, powers = self._planned[other]
                # Beyond its plan a room is heated as it was on the whole.
                rest = powers[(index - planned) // EVERY :]
                known[other][HEATER] = [*rest, *[float(powers.mean())] * steps][:steps]
        return known


def settings_of(scene: Scene, room: int, margin: float = 0.0) -> Any:
    one = scene.of.rooms[room]
    return mpc().Settings(
        one.name,
        HEATER,
        power=one.heater,
        low=one.use.by_night + margin,
        high=WARMEST,
        step=DECISION,
        horizon=HORIZON,
    )


def lowest(life: Any, local: float, room: int, steps: int, margin: float = 0.0) -> list[float]:
    """The lower end of comfort after each step of a plan, and during it, and `margin` K more."""
    ends = [float(life.set_points(local + k * DECISION)[room]) + margin for k in range(steps + 1)]
    return [max(pair) for pair in pairwise(ends)]


def by_plan_step(series: Array) -> Array:
    """(K / EVERY, ...): means of `series` (K, ...) over the steps of a plan."""
    return np.asarray(series.reshape(-1, EVERY, *series.shape[1:]).mean(axis=1))
