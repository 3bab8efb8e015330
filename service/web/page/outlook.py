"""What the overview shows and no zone keeps: the next hours and the last day of every zone.

Both are made while somebody watches, zone after zone, and take at most a set share of one thread: a thousand zones are
then some minutes behind, but neither their samples nor anybody's question waits for the overview.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple

from service.errors import ServiceError
from service.forecast.request import ForecastRequest
from service.forecast.site import forecasts
from service.records.series import Series
from service.records.view import ZoneView
from service.web.page.payloads import ExpectedPayload, SparkPayload

LEADS = (3600, 6 * 3600)
"""How far ahead the overview looks, s."""

SHORT_PERIOD = 30.0
"""Zones with shorter periods (s), such as those of a simulation in a hurry, look as many periods ahead and back as
zones of 5 min would: a day of seconds is too much to forecast at a glance, and not what such a zone is about."""

_USUAL_PERIOD = 300

LEVEL = 0.95
SPARK_POINTS = 48
SPARK_STEP = 1800
"""Points of a sparkline, and s of each: one day."""

SHARE = 0.25
"""Share of the time in which forecasts for the overview are under way, at most."""

_IDLE_SECONDS = 1.0
_log = logging.getLogger(__name__)


class Outlook(NamedTuple):
    """The next hours of the first output, inputs held, after the sample at `sample_time`; `valid_time` is when they
    begin. UTC s."""

    sample_time: int
    valid_time: int
    expected: tuple[ExpectedPayload, ...]


class Spark(NamedTuple):
    """The last day up to the sample at `sample_time`, UTC s."""

    sample_time: int
    line: SparkPayload

    @classmethod
    def of(cls, sample_time: int, series: Series) -> Spark:
        """A line with a place for every step, measured or not."""
        by_time: dict[int, float] = dict(zip(series.times.tolist(), series.means["y"].tolist(), strict=True))
        first = min(by_time, default=sample_time)
        # As a line of 24 pixels needs it: a thousand zones have 48,000 of these.
        values = (round(by_time.get(when, math.nan), 2) for when in range(first, sample_time + 1, series.bucket))
        return cls(sample_time, SparkPayload(first, series.bucket, tuple(values)))


def scaled(seconds: int, period: float) -> int:
    """A time of the overview (s) for a zone with this period (s), rounded to whole periods."""
    usual = period if period >= SHORT_PERIOD else _USUAL_PERIOD
    return max(1, round(seconds / usual)) * round(period)


class Outlooks:
    """Outlook and sparkline of every zone, as far as they are known. For the event loop alone."""

    def __init__(self, zones: Mapping[str, ZoneView], news: Callable[[str], None]) -> None:
        """`news` is told the zones of which there is something new."""
        self.outlooks: dict[str, Outlook] = {}
        self.sparks: dict[str, Spark] = {}
        self._zones = zones
        self._news = news
        self._watchers = 0
        self._work: asyncio.Task[None] | None = None

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Keep them up to date for as long as the context of anybody lasts."""
        self._watchers += 1
        if self._work is None:
            self._work = asyncio.create_task(self._keep_up())
        try:
            yield
        finally:
            self._watchers -= 1
            if not self._watchers:
                self._work.cancel()
                self._work = None

    async def _keep_up(self) -> None:
        while True:
            for known in (self.outlooks, self.sparks):
                for gone in known.keys() - self._zones.keys():
                    del known[gone]
            worked = False
            # Sparklines first: they are quick, and a table without them looks broken.
            for refresh in (self._spark, self._outlook):
                for name in list(self._zones):
                    view = self._zones.get(name)
                    try:
                        if view is not None and await refresh(name, view):
                            worked = True
                            self._news(name)
                    except ServiceError as error:
                        _log.debug("zone '%s' has no outlook now: %s", name, error)
                    except Exception as error:
                        # One zone that cannot look ahead must not leave the others without.
                        _log.warning("zone '%s' has no outlook now: %r", name, error)
            if not worked:
                await asyncio.sleep(_IDLE_SECONDS)

    async def _spark(self, name: str, view: ZoneView) -> bool:
        """Whether the last day of a zone was read; it is once there is another point of it."""
        last, known, step = view.status().last_sample_time, self.sparks.get(name), scaled(SPARK_STEP, view.period)
        if last is None or (known is not None and known.sample_time // step == last // step):
            return False
        end = last - last % step + step
        self.sparks[name] = Spark.of(last, await view.series(end - SPARK_POINTS * step, end, SPARK_POINTS + 1))
        return True

    async def _outlook(self, name: str, view: ZoneView) -> bool:
        """Whether there is a new outlook of a zone."""
        update, known = view.latest(), self.outlooks.get(name)
        if update is None or (known is not None and known.sample_time == update.time):
            return False
        ahead = [round(scaled(lead, view.period) / view.period) for lead in LEADS]
        began = time.monotonic()
        request = ForecastRequest([view], ahead[-1] * view.period, (LEVEL,))
        (fan,) = await forecasts(request, request.plans[0])
        await asyncio.sleep((time.monotonic() - began) * (1.0 / SHARE - 1.0))
        if isinstance(fan, ServiceError):
            raise fan
        if fan is None:
            return False
        (output, *_), period = fan.outputs, view.period
        columns = (output.mean, output.lower[0], output.upper[0])
        expected = tuple(ExpectedPayload(step * period, *(float(column[step]) for column in columns)) for step in ahead)
        self.outlooks[name] = Outlook(fan.update.time, fan.update.forecast.valid_time, expected)
        return True
