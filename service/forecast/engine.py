"""The engine of every forecast over several steps: one zone under one plan, from one state of its worker."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from adapters.reading import Quality
from estimator.arrays import Array
from estimator.bank.bank import answering_plan
from estimator.statespace.matrices import of_draws
from estimator.statespace.simulate import Room, Simulation, sampled_paths
from estimator.thermostat.live import Fan as LiveFan
from estimator.types import Mixtures
from estimator.verification.one_step import one_step
from estimator.verification.summaries import Summary, as_distributed, summary
from service.errors import ServiceError
from service.forecast.foresight import foresee
from service.forecast.learned import model_draws
from service.forecast.plan import Inputs, column
from service.forecast.planned import PlannedZone
from service.forecast.request import Detail
from service.forecast.shares import Shares
from service.records.fan import CompactOutputPayload, Fan
from service.records.outlook import InputOrigin, Outlook, Weather
from service.records.update import Update
from service.zone.worker import ZoneWorker

GIVEN_UP = "the forecast was given up because the daemon is stopping, or nobody waits for it"
ROOM_DRAWS = 32
"""Draws whose mean stands for a room that is simulated with its neighbours."""
_AT_ONCE = 100
"""Steps between two looks at whether anybody still waits for the forecast."""


class Neighbour(NamedTuple):
    """What a neighbour is forecast to do: the values (h,) of an input over the periods from UTC s `start` on."""

    start: float
    values: Array
    origin: InputOrigin


class FanQuestion(NamedTuple):
    """Asks a zone for its forecast over `steps` steps. See `service.records.view.Question`."""

    steps: int
    planned: Inputs
    """By channel; what is not planned is foreseen."""
    levels: tuple[float, ...]
    scenarios: int
    detail: Detail
    neighbours: Mapping[str, Neighbour] = {}
    """By channel."""

    def __call__(self, worker: ZoneWorker, weather: Weather, given_up: Callable[[], bool]) -> Fan | None:
        """The forecast; None where there is none. ServiceError once `given_up`, NoModel for scenarios without
        physics."""
        standing = worker.unstalled
        if standing is None:
            return None
        zone = PlannedZone.of(worker, standing, self.planned, self.steps)
        outlook = _inputs(zone, weather, self.neighbours)
        ahead = zone.ahead(outlook)
        lawful = zone.with_law(ahead)
        futures = _futures(zone, ahead.rows, self.detail) if lawful is None else lawful.outputs
        found = _summaries(zone, futures, self, given_up)
        obeys = () if lawful is None else zone.obedient
        paths = _paths(zone, ahead.rows, self.scenarios, lawful if obeys else None, futures)
        origins = tuple(
            replace(one, origin="thermostat", age=float("nan"), quality=Quality.GOOD) if one.channel in obeys else one
            for one in outlook.origins
        )
        return Fan(standing.update, self.levels, _columns(worker, found, len(self.levels), paths), origins)


class Part(NamedTuple):
    """A zone that is simulated with its neighbours: its inputs as far as they are known without them, and its room."""

    update: Update
    outlook: Outlook
    room: Room


class PartQuestion(NamedTuple):
    """Asks a zone for what its neighbours have to know; `fan` is what it is asked afterwards."""

    fan: FanQuestion

    def __call__(self, worker: ZoneWorker, weather: Weather, given_up: Callable[[], bool]) -> Part | None:
        """The part; None where there is no forecast now."""
        standing = worker.unstalled
        if standing is None:
            return None
        zone = PlannedZone.of(worker, standing, self.fan.planned, self.fan.steps)
        outlook = _inputs(zone, weather, self.fan.neighbours)
        draws = worker.estimator.draws(standing.state, ROOM_DRAWS)
        if draws is not None:
            room = zone.law_room(draws) or Simulation(of_draws(draws, worker.period, 1), zone.driving)
            return Part(standing.update, outlook, room)
        futures = _futures(zone, zone.ahead(outlook).rows, self.fan.detail)
        path = np.einsum("ln,lyn->ly", futures.weights, futures.means) / futures.weights.sum(axis=1, keepdims=True)
        return Part(standing.update, outlook, FixedRoom(path))


class FixedRoom:
    """A room without physics: its forecast as it is, whatever its neighbours do."""

    def __init__(self, path: Array) -> None:
        """`path` (h + 1, n_y): means of its outputs."""
        self._path, self._step = path, 0

    def outputs(self) -> Array:
        """(n_y,) [degC] now."""
        return self._path[min(self._step, len(self._path) - 1)]

    def step(self, inputs: Array) -> None:
        self._step += 1

    def anew(self) -> "FixedRoom":
        return FixedRoom(self._path)


def _inputs(zone: PlannedZone, weather: Weather, neighbours: Mapping[str, Neighbour]) -> Outlook:
    """The inputs of the steps: as planned, otherwise those of the neighbours, otherwise as foreseen."""
    standing, planned, grid = zone.standing, zone.planned, zone.grid
    foreseen = foresee(zone.worker, standing, grid.steps, weather)
    rows, origins, own = foreseen.rows.copy(), list(foreseen.origins), Shares.of(zone.worker).medians
    for place, channel in enumerate(zone.network.inputs):
        if channel in planned:
            values = column(planned[channel], grid)
            known = ~np.isnan(values)
            rows[known, place] = values[known] / own[place]
            quality = Quality.GOOD if known.all() else Quality.UNCERTAIN
            origins[place] = InputOrigin(channel, "plan", "", float("nan"), quality)
        elif channel in neighbours:
            start, values, origin = neighbours[channel]
            # A sample may have come since the rooms were simulated together, or this room is behind the others.
            index = np.arange(grid.steps) + round((grid.start - start) / grid.period)
            known = index >= 0
            if known.any():
                rows[known, place] = values[np.minimum(index[known], len(values) - 1)]
                origins[place] = origin
    return Outlook(rows, tuple(origins))


def _futures(zone: PlannedZone, rows: Array, fine: Detail) -> Mixtures:
    """What the zone will do under `rows` (h, n_u): the only place that asks an estimator for futures."""
    estimator, network, state = zone.worker.estimator, zone.network, zone.standing.state
    if any(channel in zone.planned and network.channel_unit(channel) == "W" for channel in network.heat_channels):
        state = answering_plan(estimator, state)
    return estimator.unfold(estimator.issue(state, min(fine.draws, estimator.forecast_draws)), rows)


def _summaries(zone: PlannedZone, futures: Mixtures, asked: FanQuestion, given_up: Callable[[], bool]) -> Summary:
    """Moments, and the median and bounds of every output at every step."""
    estimator, levels = zone.worker.estimator, asked.levels
    tails = np.array([0.5, *(0.5 - level / 2 for level in levels), *(0.5 + level / 2 for level in levels)])
    # The first step is the published forecast, to the last digit.
    now = one_step(estimator.predictive(zone.standing.state), levels)
    quantiles = np.hstack([now.median[:, None], now.lower, now.upper])
    found = [Summary(now.mean[None], now.sd[None], quantiles[None])]
    for first in range(1, len(futures.means), _AT_ONCE):
        if given_up():
            raise ServiceError(GIVEN_UP)
        found.append(summary(futures.during(slice(first, first + _AT_ONCE)), tails, asked.detail.exact))
    return Summary(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _columns(worker: ZoneWorker, found: Summary, count: int, paths: Array) -> tuple[CompactOutputPayload, ...]:
    return tuple(
        CompactOutputPayload(
            name,
            found.means[:, place],
            found.quantiles[:, place, 0],
            found.sds[:, place],
            found.quantiles[:, place, 1 : 1 + count].T,
            found.quantiles[:, place, 1 + count :].T,
            paths[:, :, place],
        )
        for place, name in enumerate(worker.network.measured)
    )


def _paths(zone: PlannedZone, rows: Array, count: int, lawful: LiveFan | None, futures: Mixtures) -> Array:
    """(count, h + 1, n_y): sampled futures under `rows` (h, n_u), or of the forecast with the law; `futures` is what
    the zone forecasts."""
    worker, standing = zone.worker, zone.standing
    if count == 0:
        return np.empty((0, len(rows) + 1, len(worker.network.measured)))
    if lawful is not None:
        return lawful.paths(count)
    own = getattr(worker.estimator, "scenarios", None)
    if own is not None:
        return own(standing.state, rows, count)
    draws = model_draws(worker, standing, count)
    origin = standing.update.time // worker.period
    paths = sampled_paths(draws, worker.period, rows, worker.settings.seed, origin)
    if not draws.member:
        return paths
    # The draws of a bank are those of one member, its forecast is that of all; the first step is the published one.
    now = worker.estimator.predictive(standing.state)
    return as_distributed(paths, futures.during(slice(1, None)).after(now))
