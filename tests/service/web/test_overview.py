"""The routes behind the page: all zones at a glance, their stream, and history in buckets."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fastapi import FastAPI
from prometheus_client import CollectorRegistry
from support.fake_zones import PERIOD, START, FakeZone, announced, broken, doubted, make_update, running, waiting
from support.http_client import get, problem, request
from support.schemas import objects
from support.served import Client, config, serving
from support.waiting import until

from service.publish.changes import Changes
from service.records.trust import HorizonTrust, Trust
from service.records.update import Disturbance
from service.web.app import Backend, create_app
from service.web.keys import KeyRing, create_key
from service.web.page import outlook, overview
from service.web.page.outlook import Outlook, Outlooks, scaled


@pytest.fixture
def zones() -> dict[str, FakeZone]:
    return {zone.id: zone for zone in (running("living", 300), waiting("attic"), doubted("cellar"))}


@pytest.fixture
def app(zones: dict[str, FakeZone]) -> FastAPI:
    return create_app("htwg", zones, CollectorRegistry(), backend=Backend(time_zone="Europe/Berlin"))


def test_the_overview_has_every_zone_in_one_answer(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    found = objects(get(app, "/overview").text)
    assert (found.site, found.time_zone) == ("htwg", "Europe/Berlin")
    assert [zone.id for zone in found.zones] == ["living", "attic", "cellar"]
    living, attic, cellar = found.zones
    assert living.temperature == zones["living"].updates[-1].y[0]
    assert not living.disturbed
    assert (attic.temperature, attic.sample_time, attic.reason) == (None, None, "no reading of T_out yet")
    assert [finding.subject for finding in cellar.findings] == ["C_air", "C_h", "ground"]
    assert living.expected == [], "nothing is computed for a single request"
    assert zones["living"].asked == []


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


async def follow(server: Any, path: str = "/overview/stream") -> Client:
    client = await Client.to(server, limit=2**24)
    await client.send(f"GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n".encode())
    return client


async def test_the_stream_brings_outlook_and_sparkline_and_then_what_changes(
    zones: dict[str, FakeZone], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(overview, "PAUSE", 0.01)
    changes = Changes()
    app = create_app("htwg", zones, CollectorRegistry(), backend=Backend(changes=changes))
    async with serving(app, config()) as server:
        client = await follow(server)
        rows: dict[str, Any] = {}
        while not (rows.get("living") and rows["living"].expected):
            rows |= {row.id: row for row in (await read_rows(client)).zones if row.expected}
        living = rows["living"]
        assert [one.lead_s for one in living.expected] == [3600.0, 21600.0]
        assert living.expected[0].lower < living.expected[0].mean < living.expected[0].upper
        answer = await whole(server)
        spark = answer.zones[0].spark
        assert spark is not None
        assert len(spark.values) <= 48
        assert spark.values[-1] == pytest.approx(zones["living"].updates[-1].y[0], abs=0.3)
        zones["living"].state = "failed"
        zones["living"].reason = "it diverged"
        changes.publish(announced("living", zones["living"].latest(), zones["living"].status()))
        row = None
        while row is None or row.state != "failed":
            row = next((row for row in (await read_rows(client)).zones if row.id == "living"), row)
        assert row.expected == [], "nobody vouches for it any more"
        del zones["living"]
        changes.remove("living")
        while "living" not in (await read_rows(client)).removed:
            pass
        await client.close()


def test_what_was_expected_long_ago_is_not_shown(zones: dict[str, FakeZone]) -> None:
    zone = zones["living"]
    update = zone.updates[-1]
    fresh, old = (Outlook(update.time - age, update.time, ((3600.0, 20.0, 19.0, 21.0),)) for age in (600, 7200))
    assert overview.overview_row(zone, fresh, None).expected
    assert overview.overview_row(zone, old, None).expected == ()


async def test_a_stream_ends_with_the_daemon(zones: dict[str, FakeZone], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(overview, "PAUSE", 1e6)
    changes = Changes()
    app = create_app("htwg", zones, CollectorRegistry(), backend=Backend(changes=changes))
    async with serving(app, config()) as server:
        client = await follow(server)
        await read_rows(client)
        changes.close()
        assert (await client.ended()).endswith(b"0\r\n\r\n"), "also while news gathers"
        late = await follow(server)
        assert (await late.ended()).endswith(b"0\r\n\r\n")
        await client.close()
        await late.close()


async def whole(server: Any) -> Any:
    client = await Client.to(server)
    try:
        return objects((await client.ask("/overview")).body)
    finally:
        await client.close()


async def test_what_changes_often_is_sent_once(zones: dict[str, FakeZone]) -> None:
    changes = Changes()
    with changes.watched() as watcher:
        for step in range(1000):
            changes.publish(announced("living", make_update(step), zones["living"].status()))
        changes.publish(announced("attic", None, zones["attic"].status()))
        assert await watcher.changed() == ["living", "attic"]
    changes.publish(announced("living", make_update(0), zones["living"].status()))


async def test_nothing_is_computed_once_nobody_watches(zones: dict[str, FakeZone]) -> None:
    outlooks = Outlooks(zones, lambda name: None)
    with outlooks.watched(), outlooks.watched():
        await until(lambda: "living" in outlooks.outlooks and "living" in outlooks.sparks)
    zones["living"].asked.clear()
    zones["living"].updates.append(make_update(300))
    await asyncio.sleep(0)
    assert zones["living"].asked == []
    with outlooks.watched():
        await until(lambda: outlooks.outlooks["living"].sample_time == make_update(300).time)


def test_a_zone_that_fails_leaves_the_others_their_outlook(
    zones: dict[str, FakeZone], caplog: pytest.LogCaptureFixture
) -> None:
    zones = {"cellar": broken("cellar"), **zones}

    async def explode(*_: object) -> None:
        raise RuntimeError("no such matrix")

    zones["attic"] = running("attic")
    zones["attic"].ask = explode  # type: ignore[assignment]

    async def run() -> None:
        outlooks = Outlooks(zones, lambda name: None)
        with outlooks.watched():
            await until(lambda: "living" in outlooks.outlooks)
            del zones["living"]
            await until(lambda: "living" not in outlooks.outlooks)
        assert "attic" not in outlooks.outlooks

    asyncio.run(run())
    assert "zone 'attic' has no outlook now: RuntimeError('no such matrix')" in caplog.text


@pytest.mark.parametrize(
    ("seconds", "period", "expected"),
    [
        (3600, 300.0, 3600),
        (21600, 300.0, 21600),
        (3600, 7200.0, 7200),
        (21600, 1.0, 72),
        (3600, 1.0, 12),
        (3600, 30.0, 3600),
    ],
)
def test_zones_in_a_hurry_look_as_many_periods_ahead_as_others(seconds: int, period: float, expected: int) -> None:
    assert scaled(seconds, period) == expected


def test_outlooks_take_their_share_of_the_time_at_most(
    zones: dict[str, FakeZone], monkeypatch: pytest.MonkeyPatch
) -> None:
    slept: list[float] = []
    real = asyncio.sleep

    async def sleep(seconds: float) -> None:
        slept.append(seconds)
        await real(0)

    clock = iter(range(10_000))
    monkeypatch.setattr(outlook, "time", SimpleNamespace(monotonic=lambda: float(next(clock))))
    monkeypatch.setattr(outlook.asyncio, "sleep", sleep)

    async def run() -> None:
        outlooks = Outlooks(zones, lambda name: None)
        with outlooks.watched():
            while "living" not in outlooks.outlooks:
                await real(0)

    asyncio.run(run())
    assert slept[0] == 3.0, "a forecast that takes 1 s is followed by 3 s without"


def test_a_key_for_some_zones_sees_these_at_a_glance(zones: dict[str, FakeZone], tmp_path: Path) -> None:
    ring = KeyRing(tmp_path / "keys.json", required=True)
    secret = create_key(tmp_path / "keys.json", "tenant", "read", ["attic"])
    app = create_app("htwg", zones, CollectorRegistry(), keys=ring)
    answer = request(app, "GET", "/overview", headers={"Authorization": f"Bearer {secret}"})
    assert [zone["id"] for zone in answer.json()["zones"]] == ["attic"]
    assert request(app, "GET", "/overview").status_code == 401


def test_a_series_is_the_history_in_buckets(app: FastAPI) -> None:
    found = objects(get(app, "/zones/living/series?points=50").text)
    assert found.bucket_s % PERIOD == 0
    assert len(found.times) == len(found.y) == len(found.upper) == len(found.inputs[0].values) <= 50
    assert [(one.channel, one.unit) for one in found.inputs] == [("T_out", "degC"), ("T_adj", "degC"), ("u_heat", "W")]
    assert all(low <= mean <= high for low, mean, high in zip(found.y_low, found.y, found.y_high, strict=True) if mean)


def test_a_series_of_a_stretch(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    found = get(app, "/zones/living/series?start=2025-05-03T01:00:00Z&end=2025-05-03T02:00:00Z").json()
    assert (found["times"][0], len(found["times"]), found["bucket_s"]) == ("2025-05-03T01:00:00Z", 12, 300.0)
    assert zones["living"].asked[-1] == ("series", START + 3600, START + 7200, 800)


def test_a_series_has_gain_and_set_point_where_they_are_known(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    path = "/zones/living/series?start=2025-05-03T01:00:00Z&end=2025-05-03T02:00:00Z"
    assert [get(app, path).json()[name] for name in ("setpoint", "gain")] == [None, None]
    updates = zones["living"].updates
    gain = Disturbance((-50.0, 120.0, 310.0), 0.9, ((0.04, 0.05, 0.06),))
    updates[13] = updates[13]._replace(disturbance=gain, setpoint=20.5)
    found = get(app, path).json()
    assert found["setpoint"] == [None, 20.5, *[None] * 10]
    assert (found["gain"]["unit"], found["gain"]["median"][:3]) == ("W", [None, 120.0, None])
    assert (found["gain"]["lower"][1], found["gain"]["upper"][1]) == (-50.0, 310.0)


def test_a_zone_without_samples_has_an_empty_series(app: FastAPI) -> None:
    assert get(app, "/zones/attic/series").json()["times"] == []


def test_wrong_stretches_are_refused(app: FastAPI) -> None:
    for path in ("end=0001-01-01T00:00:00Z", "end=9999-12-31T23:59:59.5Z"):
        assert "is not before end" in problem(get(app, f"/zones/living/series?{path}"), 422)["detail"]
    assert get(app, "/zones/living/series?start=0001-01-01T00:00:00Z").status_code == 200
    backwards = get(app, "/zones/living/series?start=2025-05-03T02:00:00Z&end=2025-05-03T01:00:00Z")
    assert "is not before end" in problem(backwards, 422)["detail"]
    assert "points" in problem(get(app, "/zones/living/series?points=9999"), 422)["detail"]
    assert get(app, "/zones/nowhere/series").status_code == 404
