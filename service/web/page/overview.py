"""The routes over all zones at a glance: one request for all of them, and one stream of what changes."""

import logging
import math
from collections.abc import AsyncIterator, Iterator, Sequence
from typing import Literal, NamedTuple, Self

import numpy as np
from fastapi import APIRouter, Response
from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event

from adapters.reading import Quality
from service.errors import ServiceError
from service.forecast.heating import COLD
from service.forecast.room import WARM, Comfort, Past, for_the_model
from service.publish.events import RECONNECT_MS, Event
from service.publish.payloads import AHEAD_STEP, AheadPayload, periods
from service.records.record import document
from service.records.series import Series
from service.records.view import ZoneView
from service.web.access import Asking, Caller
from service.web.answering import route, streamed, streaming
from service.web.page.payloads import (
    ExpectedPayload,
    FindingName,
    OverviewChange,
    OverviewPayload,
    OverviewRow,
    SparkPayload,
)
from service.web.page.room import DAYS, POINTS
from service.web.site import Here, Site

LEADS = (3600, 6 * 3600)
"""How far ahead the overview looks, s."""
PAUSE = 1.0
"""s between two events of one client: what changes meanwhile goes into one."""
ROWS_AT_ONCE = 100
"""Rows in an event; other requests have their turn before the next."""
_KEPT = 3 * 3600
"""What was expected is shown for so many s of the zone's time: with many zones the next look ahead takes a while."""
_WARMING = 6 * 3600
"""s after a rise of its set-point in which a room that is colder may still be warming up."""
_SILENT = ("stalled", "failed", "waiting")
"""States in which nobody vouches for what was expected."""

_log = logging.getLogger(__name__)


class Spark(NamedTuple):
    """The last day up to the sample at `sample_time`, UTC s, and what the room often was in the last DAYS."""

    sample_time: int
    line: SparkPayload
    lowest_setpoint: float
    """degC, in the last _WARMING."""
    too_cold: float
    """h, against the set-point."""
    too_warm: float
    """h, against the highest set-point of DAYS: in a setback a room may cool down."""
    often: Literal["", "cold", "warm"]
    """As in the answers about the room."""
    often_h: float
    """h of DAYS in which it was so."""

    @classmethod
    def of(cls, sample_time: int, series: Series) -> Self:
        """From the `series` of DAYS; a line with a place for every step, measured or not."""
        begin = sample_time - sample_time % series.bucket - (POINTS - 1) * series.bucket
        times, measured, setpoint = (
            each[series.times >= begin] for each in (series.times, series.means["y"], series.means["setpoint"])
        )
        by_time: dict[int, float] = dict(zip(times.tolist(), measured.tolist(), strict=True))
        first = min(by_time, default=sample_time)
        # As a line of 24 pixels needs it: a thousand zones have 48,000 of these.
        values = (round(by_time.get(when, math.nan), 2) for when in range(first, sample_time + 1, series.bucket))
        cold = measured < setpoint - COLD
        warm = (measured > np.fmax.reduce(series.means["setpoint"], initial=np.nan) + WARM) & np.isfinite(setpoint)
        too_cold, too_warm = (float(when.sum()) * series.bucket / 3600.0 for when in (cold, warm))
        line = SparkPayload(first, series.bucket, tuple(values))
        lowest = float(np.fmin.reduce(setpoint[times > sample_time - _WARMING], initial=np.nan))
        comfort = Comfort.of(Past.of(series))
        often_h = comfort.hours_of[comfort.often == "warm"] if comfort.often else 0.0
        return cls(sample_time, line, lowest, too_cold, too_warm, comfort.often, often_h)


def overview_routes(site: Site) -> APIRouter:
    """The routes over the zones of `site`."""
    zones, streams = site.zones, site.streams
    router = APIRouter(tags=["overview"])
    sparks: dict[str, Spark] = {}

    def row(zone: ZoneView, drawn: bool = True) -> OverviewRow:
        return overview_row(zone, streams.ahead.get(zone.id), sparks.get(zone.id), drawn)

    @route(router, "GET /overview", OverviewPayload, refused=(500,))
    def overview(site: Here, caller: Asking) -> OverviewPayload:
        """Every zone at a glance"""
        rows = tuple(row(zone) for name, zone in tuple(zones.items()) if caller.sees(name))
        return OverviewPayload(site.backend.time_zone, rows)

    @route(router, "GET /overview/stream", refused=(429, 500, 503), **streaming("`rows`, an OverviewChange each"))
    async def stream(site: Here, caller: Asking) -> Response:
        """What changes at a glance, at most once a second"""
        return streamed(_events(caller))

    async def _events(caller: Caller) -> AsyncIterator[bytes]:
        with streams.opened() as news:
            yield format_sse_event(retry=RECONNECT_MS)
            shown: dict[str, int] = {}
            # The sparklines of all zones that nobody has looked at lately.
            news.put(Event(name, b"") for name in zones)
            while not news.ended:
                changed = [name for name in await news.news() if caller.sees(name)]
                if not changed:
                    yield KEEPALIVE_COMMENT
                for first in range(0, len(changed), ROWS_AT_ONCE):
                    change = await _change(changed[first : first + ROWS_AT_ONCE], shown)
                    yield format_sse_event(event="rows", data_str=document(change, site.id).decode())
                await news.rest(PAUSE)

    async def _change(names: Sequence[str], shown: dict[str, int]) -> OverviewChange:
        """The rows of `names`; `shown` is of which time the client has the sparkline of each zone."""
        rows, removed = [], []
        for name in names:
            zone = zones.get(name)
            if zone is None:
                removed.append(name)
                shown.pop(name, None)
                sparks.pop(name, None)
                continue
            spark = await _spark(zone)
            news = spark is not None and shown.get(name) != spark.sample_time
            if spark is not None:
                shown[name] = spark.sample_time
            rows.append(row(zone, news))
        return OverviewChange(tuple(rows), tuple(removed))

    async def _spark(zone: ZoneView) -> Spark | None:
        """The last day of a zone, read once there is another point of it."""
        last, known = zone.now().status.last_sample_time, sparks.get(zone.id)
        step = _seconds(AHEAD_STEP, zone.period)
        if last is None or (known is not None and known.sample_time // step == last // step):
            return known
        end = last - last % step + step
        try:
            sparks[zone.id] = Spark.of(last, await zone.series(end - DAYS * POINTS * step, end, DAYS * POINTS + 1))
        except ServiceError as error:
            _log.debug("zone '%s' has no sparkline now: %s", zone.id, error)
        return sparks.get(zone.id)

    return router


def overview_row(zone: ZoneView, ahead: AheadPayload | None, day: Spark | None, drawn: bool = True) -> OverviewRow:
    """`zone` at a glance, with as much of the hours ahead and of its last `day` as is known; without the line of that
    unless it is to be `drawn`."""
    status, update, trusted = zone.now()
    often: Literal["", "cold", "warm"] = "" if day is None else day.often
    trust = trusted.at(_seconds(LEADS[-1], zone.period))
    expected: tuple[ExpectedPayload, ...] = ()
    if ahead is not None and update is not None and status.state not in _SILENT and ahead.quality is not Quality.BAD:
        expected = tuple(_expected(ahead, update.forecast.valid_time, zone.period))
    return OverviewRow(
        zone.id,
        status.state,
        status.reason,
        zone.period,
        sample_time=None if update is None else update.time,
        temperature=math.nan if update is None else update.y[0],
        setpoint=math.nan if update is None else update.setpoint,
        risen=update is not None and day is not None and update.setpoint > day.lowest_setpoint + COLD,
        disturbed=update is not None and update.shown_gate.regime == "high",
        expected=expected,
        expected_from=update.forecast.valid_time if update is not None and expected else None,
        trust=None if trust is None else trust.level,
        trust_reason="" if trust is None else trust.reason or trusted.beaten,
        good_up_to_s=float(trusted.good_up_to),
        findings=tuple(FindingName(one.finding, one.subject) for one in status.diagnosis.findings),
        too_cold_h=math.nan if day is None else day.too_cold,
        too_warm_h=math.nan if day is None else day.too_warm,
        often=often,
        often_h=math.nan if day is None else day.often_h,
        to_do=bool(often) or any(for_the_model(status.diagnosis, trusted)),
        spark=day.line if day is not None and drawn else None,
    )


def _seconds(seconds: int, period: float) -> int:
    """A time of the overview (s) for a zone with this period (s), rounded to whole periods."""
    return periods(seconds, period) * round(period)


def _expected(ahead: AheadPayload, start: int, period: float) -> Iterator[ExpectedPayload]:
    """What is expected some time after UTC s `start`, read from the fan of the last look ahead."""
    first = ahead.outputs[0]
    times = ahead.valid_time + ahead.step_s * np.arange(len(first.mean))
    for lead in (_seconds(lead, period) for lead in LEADS):
        if start - ahead.valid_time <= _seconds(_KEPT, period) and start + lead <= times[-1]:
            at = (float(np.interp(start + lead, times, each)) for each in (first.mean, first.lower, first.upper))
            yield ExpectedPayload(lead, *at)
