"""Forecasts with the law of the thermostat inside: under planned set-points, and where nobody plans the heating."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from estimator.statespace.matrices import of_draws
from estimator.statespace.simulate import Driving
from estimator.thermostat.closed_loop import LawRoom
from estimator.thermostat.live import Ahead
from estimator.thermostat.live import Fan as LiveFan
from estimator.thermostat.thermostat import Thermostat
from estimator.types import ModelDraws
from service.errors import NoLaw
from service.forecast.plan import Grid, Inputs, column
from service.records.outlook import SET_POINTS, Outlook
from service.zone.worker import Standing, ZoneWorker


def ahead_of(worker: ZoneWorker, standing: Standing, outlook: Outlook) -> Ahead:
    """What the inputs of `outlook` are to the estimator, and how sure they are."""
    start, period = standing.update.forecast.valid_time, worker.period
    rows = worker.loop.driving(start + period * np.arange(len(outlook.rows), dtype=np.float64), outlook.rows)
    return worker.loop.ahead(standing.carried, start, rows, outlook.known)


def with_law(worker: ZoneWorker, standing: Standing, ahead: Ahead, planned: Inputs, grid: Grid) -> LiveFan | None:
    """The forecast under what is foreseen `ahead` with the law inside, or, where neither set-points nor heat are
    `planned`, that of the futures of a zone with a set-point; None where a forecast under the drive rows themselves is
    asked, or nothing is known that could come in their place.

    NoLaw for planned set-points that no law keeps.
    """
    network, live, thermostat = worker.network, standing.carried.live, _unplanned(worker.network, standing, planned)
    if not grid.steps:
        return None
    before, forecasts = standing.carried.held.values, worker.loop.live
    if asks_set_points(planned, network):
        if not forecasts.obeyed(thermostat):
            raise NoLaw(why_no_law(network, standing))
        setpoints = _set_points(worker, standing, thermostat, planned, grid)
        return forecasts.planned(live, standing.state, thermostat, setpoints, ahead, before, int(grid.start))
    if _driven(network, standing) & planned.keys() or not forecasts.knows(thermostat, grid.start):
        return None
    return forecasts.unplanned(live, standing.state, thermostat, ahead, before, int(grid.start))


def law_room(
    worker: ZoneWorker, standing: Standing, draws: ModelDraws, planned: Inputs, grid: Grid, driving: Driving
) -> LawRoom | None:
    """The zone's physics with the law inside, to be simulated with its neighbours; None where `with_law` is none, or
    has no law. Without a plan the likeliest set-points come."""
    network, thermostat = worker.network, _unplanned(worker.network, standing, planned)
    if not worker.loop.live.obeyed(thermostat) or not grid.steps:
        return None
    if not asks_set_points(planned, network) and _driven(network, standing) & planned.keys():
        return None
    setpoints = _set_points(worker, standing, thermostat, planned, grid)
    before = standing.carried.held.values
    return LawRoom(of_draws(draws, worker.period, 1), thermostat.laws, setpoints, before, driving)


def obedient(network: Network, standing: Standing, planned: Inputs) -> Collection[str]:
    """The inputs that obey the law where `with_law` answers."""
    thermostat = _unplanned(network, standing, planned)
    return [network.inputs[column] for column in thermostat.laws.column.astype(int).tolist()]


def asks_set_points(planned: Inputs, network: Network) -> bool:
    """Whether `planned` are set-points, which a network with an input of that name has itself."""
    return SET_POINTS in planned and SET_POINTS not in network.inputs


def _unplanned(network: Network, standing: Standing, planned: Inputs) -> Thermostat:
    """What is known of the thermostat, without the laws of inputs that are `planned` themselves."""
    thermostat = standing.carried.thermostat
    kept = [network.inputs[int(column)] not in planned for column in thermostat.laws.column]
    return thermostat._replace(laws=type(thermostat.laws)(*(rows[kept] for rows in thermostat.laws)))


def _driven(network: Network, standing: Standing) -> set[str]:
    """The inputs whose plan is a plan of the heating: those that obey the law, or any heat where none is known."""
    laws = standing.carried.thermostat.laws
    if len(laws.column):
        return {network.inputs[int(column)] for column in laws.column}
    return {channel for channel in network.heat_channels if network.channel_unit(channel) == "W"}


def _set_points(worker: ZoneWorker, standing: Standing, thermostat: Thermostat, planned: Inputs, grid: Grid) -> Array:
    """(h,): as planned, and otherwise as is likeliest."""
    times = grid.start + grid.period * np.arange(grid.steps, dtype=np.float64)
    likely = worker.loop.live.likely(standing.carried.live, thermostat, times)
    if not asks_set_points(planned, worker.network):
        return likely
    told = column(planned[SET_POINTS], grid)
    return np.where(np.isnan(told), likely, told)


def why_no_law(network: Network, standing: Standing) -> str:
    """Why no law of a thermostat is known, in a sentence with its remedies."""
    heat = ", ".join(channel for channel in network.heat_channels if network.channel_unit(channel) == "W") or "none"
    if not len(standing.carried.thermostat.memory.times):
        return (
            f"no set-point was measured yet, so nobody knows what {SET_POINTS} does; give the zone a [zones.setpoint] "
            f"(tg.fit: a column {SET_POINTS}), or plan the heating in W ({heat})"
        )
    return (
        f"no law of the thermostat is known: no heat in W ({heat}) has obeyed the set-point over the last days, or the "
        "estimator knows no physics; plan the heating in W, or ask again after a day of heating"
    )
