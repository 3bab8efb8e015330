"""The routes behind the page: all zones at a glance, their stream, and history in buckets."""

import asyncio
from typing import Any

import pytest
from fastapi import FastAPI
from prometheus_client import CollectorRegistry
from support.fake_zones import START, FakeZone, announced, broken, doubted, running, series_of, waiting
from support.http_client import get
from support.schemas import objects
from support.served import Client, ask, config, serving

from service.forecast.ahead import LookingAhead
from service.publish.events import Streams
from service.records.trust import HorizonTrust, Trust
from service.web.app import create_app
from service.web.page import overview
from service.web.site import Backend


@pytest.fixture
def zones() -> dict[str, FakeZone]:
    return {zone.id: zone for zone in (running("living", 300), waiting("attic"), doubted("cellar"))}


@pytest.fixture
def app(zones: dict[str, FakeZone]) -> FastAPI:
    return create_app("htwg", zones, CollectorRegistry(), backend=Backend(time_zone="Europe/Berlin"))


def test_the_overview_tells_how_far_the_next_hours_are_trusted(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    assert objects(get(app, "/overview").text).zones[1].trust is None
    horizons = (
        HorizonTrust(3600, "trusted", "", START),
        HorizonTrust(21600, "doubtful", "the intervals 6 h ahead are too narrow", START),
    )
    zones["living"].trusted = Trust(START, horizons)
    (living, *_) = objects(get(app, "/overview").text).zones
    assert (living.trust, living.trust_reason) == ("doubtful", "the intervals 6 h ahead are too narrow")


async def read_rows(client: Client) -> Any:
    """The next event of a stream, as the payload that it carries."""
    data = b""
    while not data:
        line = (await asyncio.wait_for(client.reader.readline(), 180)).strip()
        if line.startswith(b"data: "):
            data = line.removeprefix(b"data: ")
    return objects(data)


async def follow(server: Any) -> Client:
    client = await Client.to(server, limit=2**24)
    await client.send(b"GET /overview/stream HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
    return client


async def test_the_stream_brings_expectations_and_sparkline_and_then_what_changes(
    zones: dict[str, FakeZone], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(overview, "PAUSE", 0.01)
    streams = Streams()
    zones["cellar"] = broken("cellar")
    app = create_app("htwg", zones, CollectorRegistry(), backend=Backend(streams=streams))
    async with serving(app, config()) as server:
        client = await follow(server)
        (rows,) = [(await read_rows(client)).zones]
        assert [(row.id, row.spark is not None, row.expected) for row in rows] == [
            ("living", True, []),
            ("attic", False, []),
            ("cellar", False, []),
        ], "a journal that cannot be read keeps no other row"
        await LookingAhead("htwg", zones, [streams]).attend("living")
        (living,) = (await read_rows(client)).zones
        assert living.spark is None, "the client has it"
        assert [one.lead_s for one in living.expected] == [3600.0, 21600.0]
        assert living.expected[0].lower < living.expected[0].mean < living.expected[0].upper
        spark = objects((await ask(server, "/overview")).body).zones[0].spark
        assert len(spark.values) <= 48
        assert spark.values[-1] == pytest.approx(zones["living"].updates[-1].y[0], abs=0.3)
        zones["living"].state = "failed"
        streams.publish(announced("living", zones["living"].now().update, zones["living"].now().status))
        (living,) = (await read_rows(client)).zones
        assert (living.state, living.expected) == ("failed", []), "nobody vouches for it any more"
        del zones["living"]
        streams.remove("living")
        assert (await read_rows(client)).removed == ["living"]


@pytest.mark.parametrize(("period", "leads"), [(300.0, [3600, 21600]), (7200.0, [7200, 21600]), (1.0, [12, 72])])
async def test_what_is_expected_is_counted_from_the_newest_sample_until_the_look_ahead_is_old(
    period: float, leads: list[int]
) -> None:
    zone, streams = running("living"), Streams()
    zone.period = period
    update = zone.updates[-1]
    begin = round(update.time + period)
    zone.updates[-1] = update._replace(forecast=update.forecast._replace(issue_time=begin, valid_time=begin))
    await LookingAhead("htwg", {"living": zone}, [streams]).attend("living")

    def expected(late: int) -> list[tuple[float, float]]:
        """What is expected when the newest sample is `late` periods after the look ahead."""
        forecast = update.forecast._replace(valid_time=round(begin + late * period))
        zone.updates[-1] = update._replace(forecast=forecast)
        row = overview.overview_row(zone, streams.ahead["living"], None)
        assert row.expected_from == (forecast.valid_time if row.expected else None)
        return [(one.lead_s, one.mean) for one in row.expected]

    first = update.forecast.outputs[0].mean
    for late in (0, 1):
        # The mean of the fake rises by 0.01 K a step.
        assert expected(late) == [(lead, pytest.approx(first + 0.01 * (late + lead / period))) for lead in leads]
    assert expected(200) == []


def test_the_last_day_tells_how_long_it_was_uncomfortable_and_a_setback_is_not_too_warm() -> None:
    zone = running("living", 288)
    # The fake is at 19.5 degC at midnight and at 22.5 degC at noon; nobody says what is meant in the last hour.
    setpoints = [17.0] * 72 + [21.5] * 72 + [23.0] * 132 + [float("nan")] * 12
    zone.updates = [one._replace(setpoint=meant) for one, meant in zip(zone.updates, setpoints, strict=True)]

    def spark() -> overview.Spark:
        last = zone.updates[-1].time
        return overview.Spark.of(last, series_of(zone, zone.updates[0].time, last + 300, 49))

    cold = sum(one.y[0] < one.setpoint - 0.5 for one in zone.updates) / 12.0
    assert spark().too_cold == pytest.approx(cold, abs=1.0)
    assert spark().too_warm == 0.0
    zone.updates = [one._replace(setpoint=17.0) for one in zone.updates]
    assert (spark().too_cold, spark().too_warm) == (0.0, 24.0)
    row = overview.overview_row(zone, None, spark(), drawn=False)
    assert (row.too_warm_h, row.spark) == (24.0, None), "what the client has is not sent again"


@pytest.mark.parametrize(("cold", "often"), [(1.5, ""), (12.0, "cold")])
def test_attention_is_needed_where_the_room_itself_names_something_to_do(cold: float, often: str) -> None:
    zone = running("living", 7 * 288)
    later = zone.updates[-round(12 * cold)].time
    zone.updates = [one._replace(setpoint=one.y[0] + (one.time >= later)) for one in zone.updates]
    last = zone.updates[-1].time
    week = overview.Spark.of(last, series_of(zone, zone.updates[0].time, last + 300, 7 * 48 + 1))
    row = overview.overview_row(zone, None, week)
    assert (row.too_cold_h, row.often, row.to_do) == (pytest.approx(cold, abs=0.5), often, bool(often))
    assert row.often_h == (row.too_cold_h if often else 0.0)
    assert len(row.spark.values) == 48
    zone.trusted = Trust(START, beaten="1 h ahead, no change is the better forecast; rely on the model 6 h ahead")
    assert overview.overview_row(zone, None, None).to_do


async def test_a_stream_ends_with_the_daemon(zones: dict[str, FakeZone], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(overview, "PAUSE", 1e6)
    streams = Streams()
    app = create_app("htwg", zones, CollectorRegistry(), backend=Backend(streams=streams))
    async with serving(app, config()) as server:
        client = await follow(server)
        await read_rows(client)
        streams.close()
        assert (await client.ended()).endswith(b"0\r\n\r\n"), "also while news gathers"
        late = await follow(server)
        assert (await late.ended()).endswith(b"0\r\n\r\n")


def test_a_series_has_a_set_point_where_it_is_known_and_may_begin_with_time(
    app: FastAPI, zones: dict[str, FakeZone]
) -> None:
    updates = zones["living"].updates
    updates[13] = updates[13]._replace(setpoint=20.5)
    found = get(app, "/zones/living/series?start=2025-05-03T01:00:00Z&end=2025-05-03T02:00:00Z").json()
    assert found["setpoint"] == [None, 20.5, *[None] * 10]
    assert get(app, "/zones/living/series?start=0001-01-01T00:00:00Z").status_code == 200
