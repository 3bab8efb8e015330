"""The route for charts: any stretch of a zone's history in a bounded number of points."""

import math
from datetime import UTC, datetime
from typing import Annotated

import numpy as np
from fastapi import APIRouter, Query

from adapters.fields.times import utc
from estimator.arrays import DAY, Array
from service.records.series import GAIN, Series
from service.records.view import ZoneView
from service.web.answering import route
from service.web.models import Instant
from service.web.page.payloads import SeriesGain, SeriesInput, SeriesPayload
from service.web.problems import invalid
from service.web.site import Asked, Here

MAX_POINTS = 2000
_DEFAULT_POINTS = 800
_EARLIEST, _LATEST = (int(datetime(year, 1, 1, tzinfo=UTC).timestamp()) for year in (1900, 2200))
"""What is asked for beyond these times, UTC s, holds nothing."""

router = APIRouter(tags=["zones"])


@route(router, "GET /zones/{zone}/series", SeriesPayload)
async def series(
    site: Here,
    view: Asked,
    start: Annotated[
        Instant | None, Query(description="first time, RFC 3339 with zone; default: a day before end")
    ] = None,
    end: Annotated[Instant | None, Query(description="end, excluded; default: after the newest sample")] = None,
    points: Annotated[int, Query(ge=10, le=MAX_POINTS, description="how many buckets at most")] = _DEFAULT_POINTS,
) -> SeriesPayload:
    """History in a bounded number of points, with the inputs: for charts"""
    until = end_of(view) if end is None else math.ceil(end.timestamp())
    since = until - DAY if start is None else math.ceil(start.timestamp())
    # Times that a time stamp can say, whatever is asked for.
    since, until = max(since, _EARLIEST), min(until, _LATEST)
    if since >= until:
        raise invalid([f"start {utc(since):%Y-%m-%dT%H:%M:%SZ} is not before end {utc(until):%Y-%m-%dT%H:%M:%SZ}"])
    return _payload(view, since, until, await view.series(since, until, points))


def _payload(zone: ZoneView, start: int, end: int, series: Series) -> SeriesPayload:
    means = {name: _numbers(column) for name, column in series.means.items()}
    known, told = (np.isfinite(series.means[name]).any() for name in (GAIN[1], "setpoint"))
    units = [(channel, zone.network.channel_unit(channel)) for channel in zone.network.inputs]
    return SeriesPayload(
        zone.network.measured[0],
        zone.period,
        series.bucket,
        start,
        end,
        tuple(series.times.tolist()),
        *(means["y"], _numbers(series.y_low), _numbers(series.y_high)),
        *(means["mean"], _numbers(series.band_low), _numbers(series.band_high)),
        *(means["alpha_median"], means["gate"], means["setpoint"] if told else None),
        SeriesGain(*(means[name] for name in GAIN)) if known else None,
        tuple(SeriesInput(*unit, _numbers(column)) for unit, column in zip(units, series.inputs.T, strict=True)),
    )


def _numbers(values: Array) -> tuple[float, ...]:
    # A chart has a thousand pixels; sixteen digits each would be most of the answer.
    return tuple(float(f"{value:.6g}") for value in values.tolist())


def end_of(zone: ZoneView) -> int:
    """When the newest sample ends, UTC s; without any, the beginning of 1970, of which there is no history."""
    last = zone.now().status.last_sample_time
    return 0 if last is None else math.ceil(last + zone.period)
