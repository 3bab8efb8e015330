"""A zone in one state, under a plan: its forecast with the law of the thermostat inside."""

from collections.abc import Collection
from typing import NamedTuple, Self

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from estimator.statespace.matrices import of_draws
from estimator.thermostat.closed_loop import LawRoom
from estimator.thermostat.live import Ahead, Now
from estimator.thermostat.live import Fan as LiveFan
from estimator.thermostat.thermostat import Thermostat
from estimator.types import ModelDraws
from service.errors import NoLaw
from service.forecast.plan import Grid, Inputs, column
from service.records.outlook import SET_POINTS, Outlook
from service.zone.worker import Standing, ZoneWorker


class PlannedZone(NamedTuple):
    """What a forecast over several steps is made from."""

    worker: ZoneWorker
    standing: Standing
    planned: Inputs
    """By channel; what is not planned is foreseen."""
    grid: Grid

    @classmethod
    def of(cls, worker: ZoneWorker, standing: Standing, planned: Inputs, steps: int) -> Self:
        """Over `steps` steps from the newest forecast on."""
        return cls(worker, standing, planned, Grid(standing.update.forecast.valid_time, worker.period, steps))

    @property
    def network(self) -> Network:
        return self.worker.network

    def driving(self, step: int, inputs: Array) -> Array:
        """What drives the estimator at one step of the grid, under inputs (n_u,)."""
        time = float(self.grid.start + step * self.grid.period)
        return self.worker.loop.driving(np.array([time]), inputs[None])[0]

    def ahead(self, outlook: Outlook) -> Ahead:
        """What the inputs of `outlook` are to the estimator, and how sure they are."""
        rows = self.worker.loop.driving(self._times, outlook.rows)
        return self.worker.loop.ahead(self.standing.carried, int(self.grid.start), rows, outlook.known)

    def with_law(self, ahead: Ahead) -> LiveFan | None:
        """The forecast under what is foreseen `ahead` with the law inside, or, where neither set-points nor heat are
        planned, that of the futures of a zone with a set-point; None where a forecast under the drive rows themselves
        is asked, or nothing is known that could come in their place.

        NoLaw for planned set-points that no law keeps.
        """
        carried, thermostat, live = self.standing.carried, self._thermostat, self.worker.loop.live
        now = Now(self.standing.state, thermostat, carried.held.values, int(self.grid.start))
        if not self.grid.steps:
            return None
        if self._plans_set_points:
            if not live.obeyed(thermostat):
                raise NoLaw(self.why_no_law)
            return live.planned(carried.live, now, self._set_points, ahead)
        if self._plans_heating or not live.knows(thermostat, self.grid.start):
            return None
        return live.unplanned(carried.live, now, ahead)

    def law_room(self, draws: ModelDraws) -> LawRoom | None:
        """The zone's physics with the law inside, to be simulated with its neighbours; None where `with_law` is none,
        or has no law. Without a plan the likeliest set-points come."""
        thermostat = self._thermostat
        if not self.worker.loop.live.obeyed(thermostat) or not self.grid.steps:
            return None
        if not self._plans_set_points and self._plans_heating:
            return None
        models, before = of_draws(draws, self.worker.period, 1), self.standing.carried.held.values
        return LawRoom(models, thermostat.laws, self._set_points, before, self.driving)

    @property
    def obedient(self) -> Collection[str]:
        """The inputs that obey the law where `with_law` answers."""
        return [self.network.inputs[place] for place in self._thermostat.laws.column.astype(int).tolist()]

    @property
    def why_no_law(self) -> str:
        """Why no law of a thermostat is known, in a sentence with its remedies."""
        heat, thermostat = ", ".join(self._power), self.standing.carried.thermostat
        if not heat:
            return (
                f"no input of the zone is heat in W, so nobody knows what {SET_POINTS} does; give it a channel u_heat, "
                "without a meter that of a valve or switch with its nominal power"
            )
        if self._plans_heating and self.worker.loop.live.obeyed(thermostat):
            return f"{SET_POINTS} and the heat that obeys it ({heat}) are both planned; plan one of them"
        if not len(thermostat.memory.times):
            return (
                f"no set-point was measured yet, so nobody knows what {SET_POINTS} does; give the zone a "
                f"[zones.setpoint] (tg.fit: a column {SET_POINTS}), or plan the heating in W ({heat})"
            )
        return (
            f"no law of the thermostat is known: no heat in W ({heat}) has obeyed the set-point over the last days, or "
            "the estimator knows no physics; plan the heating in W, or ask again after a day of heating"
        )

    @property
    def _times(self) -> Array:
        return self.grid.start + self.grid.period * np.arange(self.grid.steps, dtype=np.float64)

    @property
    def _power(self) -> list[str]:
        """The heat inputs in W."""
        return [channel for channel in self.network.heat_channels if self.network.channel_unit(channel) == "W"]

    @property
    def _thermostat(self) -> Thermostat:
        """What is known of the thermostat, without the laws of inputs that are planned themselves."""
        thermostat = self.standing.carried.thermostat
        kept = [self.network.inputs[int(place)] not in self.planned for place in thermostat.laws.column]
        return thermostat._replace(laws=type(thermostat.laws)(*(rows[kept] for rows in thermostat.laws)))

    @property
    def _plans_set_points(self) -> bool:
        """Whether set-points are planned, which a network with an input of that name has itself."""
        return SET_POINTS in self.planned and SET_POINTS not in self.network.inputs

    @property
    def _plans_heating(self) -> bool:
        """Whether inputs are planned that obey the law, or any heat where none is known."""
        laws = self.standing.carried.thermostat.laws
        driven = [self.network.inputs[int(place)] for place in laws.column] or self._power
        return any(channel in self.planned for channel in driven)

    @property
    def likely(self) -> Array:
        """(h,): the likeliest set-points [degC]; NaN where there is no law."""
        return self.worker.loop.live.likely(self.standing.carried.live, self._thermostat, self._times)

    @property
    def _set_points(self) -> Array:
        """(h,): as planned, and otherwise as is likeliest."""
        if not self._plans_set_points:
            return self.likely
        told = column(self.planned[SET_POINTS], self.grid)
        return np.where(np.isnan(told), self.likely, told)
