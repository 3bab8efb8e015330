"""From a post to the zones: whose channels are meant, what is known of nobody, and when there is nobody to take it."""

import asyncio
import logging
import time
from collections import Counter
from typing import Any

import pytest
from support.config_samples import sound, write
from support.waiting import turns_beside

from adapters.http.posted import Posted
from adapters.reading import Fault, Reading
from service.config.load import load
from service.daemon.supply.feeds import Feed, Tally
from service.daemon.supply.ingest import MAX_READINGS, TOGETHER, Ingest
from service.errors import ServiceError
from service.records.receipt import Receipt
from service.web.server.refusal import RequestRefused


class Taking:
    """A zone that takes everything, or fails."""

    def __init__(self):
        self.taken: list[tuple[str, list[Reading]]] = []
        self.failure: Exception | None = None

    @property
    def intake(self):
        """Of the zone that this stands for."""
        return self

    async def take(self, source, readings):
        if self.failure is not None:
            raise self.failure
        self.taken.append((source, list(readings)))
        return Receipt(len(readings), 0, 0, Counter({Fault.OUT_OF_ORDER: 1}))


@pytest.fixture
def zones():
    return {"living": Taking(), "bedroom": Taking()}


@pytest.fixture
def feeds(tmp_path, zones):
    """Two sources that are posted to and a recording, each at its feed."""
    tables = sound(tmp_path)
    tables["sources"] |= {"one": {"kind": "http"}, "two": {"kind": "http"}}
    channels = tables["zones"][0]["channels"]
    for name, source in (("T_i", "one"), ("T_out", "two"), ("u_heat", "one")):
        channels[name] = {"source": source, "unit": channels[name]["unit"], "aggregate": "mean"}
    config = load(write(tmp_path, tables))
    return [
        Feed(name, config, zones, [zone.id for zone in config.zones_of(name)], Tally())
        for name in ("one", "two", "log")
    ]


def lines(*fields):
    return [Posted("living", 20.0, None, field) for field in fields]


def take(ingest, posted, zone=None):
    return asyncio.run(ingest.take(posted, zone))


async def test_a_large_post_leaves_the_event_loop_to_others_and_goes_in_the_order_of_time(feeds, zones):
    posted = [Posted("living", 20.0, float(time), "T_i") for time in range(5 * TOGETHER, 0, -1)]
    posted += [Posted("nobody", 20.0, None, f"field {k}") for k in range(5 * TOGETHER)]
    with turns_beside() as turns:
        taken = await Ingest(lambda: feeds, lambda: True).take(posted, None)
    assert turns() >= 10
    assert (taken.accepted, taken.unknown, len(taken.unknown_names)) == (5 * TOGETHER, 5 * TOGETHER, 5)
    times = [reading.time for _, readings in zones["living"].taken for reading in readings]
    assert times == [float(time) for time in range(1, 5 * TOGETHER + 1)]


def test_a_post_goes_to_every_source_that_has_its_channels(feeds, zones):
    taken = take(Ingest(lambda: feeds, lambda: True), lines("T_i", "T_out", "T_cellar", "u_heat"))
    assert [(source, [reading.channel for reading in readings]) for source, readings in zones["living"].taken] == [
        ("one", ["living/T_i", "living/u_heat"]),
        ("two", ["living/T_out"]),
    ]
    assert (taken.accepted, taken.repeated, taken.refused) == (3, 0, Counter({Fault.OUT_OF_ORDER: 2}))
    assert (taken.unknown, taken.unknown_names) == (1, ("living T_cellar",))
    assert zones["bedroom"].taken == []
    assert [feed.tally.readings for feed in feeds] == [2, 1, 0]


def test_a_post_for_one_zone_reaches_no_other(feeds, zones):
    taken = take(Ingest(lambda: feeds, lambda: True), lines("T_i"), "bedroom")
    assert (taken.accepted, taken.unknown) == (0, 1)
    assert zones["living"].taken == []


def test_what_nobody_asks_for_is_said_now_and_then(feeds, caplog):
    ingest = Ingest(lambda: feeds, lambda: True)
    with caplog.at_level(logging.INFO):
        for _ in range(3):
            taken = take(ingest, lines(*(f"x{k}" for k in range(30)), "T_i"))
    assert (taken.unknown, len(taken.unknown_names)) == (30, 5)
    assert [record.message for record in caplog.records] == [
        "no channel asks for 30 of 31 posted values, such as living x0"
    ]


@pytest.mark.parametrize(("expected", "status"), [(True, 503), (False, 409)])
def test_without_a_source_to_post_to(feeds, expected, status):
    with pytest.raises(RequestRefused) as refused:
        take(Ingest(lambda: feeds[2:], lambda: expected), lines("T_i"))
    assert refused.value.status == status
    assert ("Retry-After" in refused.value.headers) == expected


def test_who_posts_again_after_a_failure_loses_no_count_of_any_zone(tmp_path, zones):
    tables = sound(tmp_path)
    tables["sources"]["one"] = {"kind": "http"}
    for zone in tables["zones"]:
        for name, channel in zone["channels"].items():
            unit = "kWh" if name == "u_heat" else channel["unit"]
            zone["channels"][name] = {"source": "one", "unit": unit, "aggregate": "mean"}
    feed = Feed("one", load(write(tmp_path, tables)), zones, list(zones), Tally())
    now = time.time()

    def post(seconds, count):
        return [Posted(zone, count, now - 1000.0 + seconds, "u_heat") for zone in zones]

    def values(zone):
        return [reading.value for _, readings in zones[zone].taken for reading in readings if reading.fault is None]

    take(Ingest(lambda: [feed], lambda: True), post(0.0, 100.0))
    zones["living"].failure = ServiceError("the journal failed; free space on its disk")
    with pytest.raises(ServiceError, match="free space"):
        take(Ingest(lambda: [feed], lambda: True), post(600.0, 101.0))
    assert values("bedroom") == pytest.approx([6000.0]), "the other zone had its share"
    zones["living"].failure = None
    take(Ingest(lambda: [feed], lambda: True), post(600.0, 101.0))
    assert values("living") == values("bedroom") == pytest.approx([6000.0])


def test_a_zone_that_a_reload_has_taken_away_takes_nothing(feeds, zones):
    del zones["living"]
    assert take(Ingest(lambda: feeds, lambda: True), lines("T_i")).accepted == 0


async def test_a_value_that_many_channels_ask_for_leaves_the_event_loop_to_others_and_is_bounded(tmp_path, monkeypatch):
    """The outdoor temperature of 50 rooms: a post of 20,000 would be a million readings."""
    tables = sound(tmp_path)
    tables["sources"]["one"] = {"kind": "http"}
    room = tables["zones"][0]
    for name, channel in room["channels"].items():
        room["channels"][name] = {"source": "one", "unit": channel["unit"], "aggregate": "mean"}
    room["channels"]["T_out"]["name"] = "outdoor"
    tables["zones"] = [room | {"id": f"room-{k}"} for k in range(50)]
    zones: dict[str, Any] = {zone["id"]: Taking() for zone in tables["zones"]}
    feed = Feed("one", load(write(tmp_path, tables)), zones, list(zones), Tally())
    ingest, now = Ingest(lambda: [feed], lambda: True), time.time()

    def outdoor(count):
        return [Posted("outdoor", 5.0, now - count + k) for k in range(count)]

    with turns_beside() as turns:
        taken = await ingest.take(outdoor(MAX_READINGS // 50), None)
    assert taken.accepted == MAX_READINGS
    assert turns() >= MAX_READINGS / TOGETHER
    for zone in zones.values():
        assert [one.time for _, readings in zone.taken for one in readings] == [one.time for one in outdoor(2000)]
        assert max(len(readings) for _, readings in zone.taken) == TOGETHER / 50
    with pytest.raises(RequestRefused, match=f"more than {MAX_READINGS} readings; post fewer") as refused:
        await ingest.take(outdoor(MAX_READINGS // 50 + 1), None)
    assert refused.value.status == 413
