"""The hours ahead of every zone, for the sinks: made beside the samples, and no sample waits for them."""

import asyncio
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, Self

import numpy as np

from adapters.reading import Quality
from estimator.verification.hindsight import HORIZONS
from service.errors import ServiceError
from service.forecast.answers import Preheat
from service.forecast.heating import COLD, PreheatQuestion, refusal
from service.forecast.request import MAX_STEPS, ForecastRequest
from service.forecast.site import forecasts, neighbourhood
from service.publish.events import Streams
from service.publish.payloads import AheadPayload, NextHeatingPayload
from service.publish.sinks import Announcement, Occasion, Reports, Sink, tell
from service.records.outlook import Weather
from service.records.trust import Trust
from service.records.view import ZoneView
from service.zone.worker import ZoneWorker

EVERY = 300
"""s on the clock of a zone from one look ahead to the next, at least."""
SHARE = 0.25
"""Share of the time in which looks ahead are under way, at most: of many zones, or of fast ones, each is rarer."""
LEVEL = 0.95
PROBABILITY = 0.9
"""Of being warm when the set-point rises."""

_log = logging.getLogger(__name__)


class NextRise(NamedTuple):
    """Asks when to raise the set-point for the zone to be warm when it is likely to rise next, within `steps` steps."""

    steps: int

    @classmethod
    def within_a_day(cls, period: float) -> Self:
        """As far as a zone with this `period` [s] looks ahead."""
        return cls(min(round(max(HORIZONS) / period) - 1, MAX_STEPS))

    def __call__(self, worker: ZoneWorker, weather: Weather, given_up: Callable[[], bool]) -> Preheat | None:
        """The answer; None without a law of the thermostat, and where the set-point does not rise next."""
        standing = worker.unstalled
        if standing is None:
            return None
        thermostat, live = standing.carried.thermostat, standing.carried.live
        if not worker.loop.live.obeyed(thermostat):
            return None
        start = standing.update.forecast.valid_time
        times = start + worker.period * np.arange(self.steps, dtype=np.float64)
        above = worker.loop.live.likely(live, thermostat, times) - thermostat.setpoint
        changes = np.flatnonzero(np.abs(above) > COLD)
        # Before a set-back nobody knows how cold the room will be at its end.
        if not len(changes) or changes[0] == 0 or above[changes[0]] < 0.0:
            return None
        target, by = float(thermostat.setpoint + above[changes[0]]), float(times[changes[0]])
        return PreheatQuestion(target, by, PROBABILITY, COLD)(worker, weather, given_up)


def next_heating(found: Preheat | None, trust: Trust) -> NextHeatingPayload | None:
    """What is told unasked of the answer to `NextRise` by a zone with this `trust`."""
    # A model that doubts that any start suffices has not seen such a night: unasked it had better be silent.
    if found is None or found.reached < 0.5 or refusal(trust, found.by - found.issue_time) is not None:
        return None
    return NextHeatingPayload(found.target, found.by, found.probability, found.start, found.reached)


class LookingAhead:
    """Announces the hours ahead of `zones` to `sinks`, which need not be asked for them."""

    def __init__(self, site: str, zones: Mapping[str, ZoneView], sinks: Sequence[Sink]) -> None:
        self.news = Streams()
        """A sink that is told of every update."""
        self._site, self._zones, self._sinks = site, zones, sinks
        self._told: dict[str, AheadPayload] = {}

    async def run(self) -> None:
        """Look ahead, for ever."""
        with self.news.opened() as news:
            for name in self._zones:
                self.news.note(name)
            while not news.ended:
                for name in await news.news():
                    try:
                        await self.attend(name)
                    except ServiceError as error:
                        _log.debug("zone '%s' does not look ahead now: %s", name, error)
                    except Exception as error:
                        # One zone that cannot look ahead must not leave the others without.
                        _log.warning("zone '%s' does not look ahead now: %r", name, error)

    async def attend(self, name: str) -> None:
        """Look ahead for the zone `name` if it is time to; also tell once that it no longer vouches for its forecast.
        ServiceError where that cannot be."""
        view, told = self._zones.get(name), self._told.get(name)
        state = None if view is None else view.now()
        if view is None or state is None or state.update is None:
            self._told.pop(name, None)
            return
        if state.status.state in ("stalled", "failed"):
            if told is not None and told.quality is not Quality.BAD:
                # A client that comes later must not take it for good.
                await self._announce(view, replace(told, quality=Quality.BAD))
            return
        if told is None or told.quality is Quality.BAD or not 0 <= state.update.time - told.sample_time < EVERY:
            await self._look(view)

    async def _look(self, view: ZoneView) -> None:
        """Look ahead for a zone and all that share walls with it."""
        rise = NextRise.within_a_day(view.period)
        if rise.steps < 1:
            return
        began, first = time.monotonic(), not self._told
        together = [view, *neighbourhood([view], self._zones)]
        request = ForecastRequest(together, rise.steps * view.period, (LEVEL,))
        for one, fan in zip(together, await forecasts(request, request.plans[0]), strict=True):
            if isinstance(fan, ServiceError):
                _log.debug("zone '%s' does not look ahead now: %s", one.id, fan)
            elif fan is not None:
                heating = next_heating(await one.ask(rise), one.now().trust)
                await self._announce(one, AheadPayload.of(fan, one.now().status, one.surroundings.limits, heating))
        # The first compiles, which no other does again.
        if not first:
            await asyncio.sleep((time.monotonic() - began) * (1.0 / SHARE - 1.0))

    async def _announce(self, view: ZoneView, ahead: AheadPayload) -> None:
        self._told[view.id] = ahead
        announcement = Announcement(self._site, view.id, view.now(), Occasion.STATUS, Reports(ahead=ahead))
        await asyncio.to_thread(tell, self._sinks, announcement)
