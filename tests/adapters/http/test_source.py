"""From posted values to readings: who is meant, when it was, what is refused."""

import asyncio
from math import inf
from typing import Any

import pytest
from support.sources import bound, source_table
from support.tables import tabled

from adapters.http.posted import Posted, from_lines, from_senml
from adapters.http.source import HttpSource
from adapters.reading import Fault, Quality, Reading

NOW = 1_772_000_000.0
TABLE = source_table("http")
ROOM = {"id": "office/T_i", "measurement": "mqtt", "tags": {"topic": "room1"}, "unit": "degC"}
ROOF = {"id": "office/T_out", "name": "roof", "unit": "degC"}
HALL = {"id": "hall/T_out", "name": "roof", "unit": "degC"}
METER = {"id": "office/u_heat", "unit": "kWh", "to": "W"}


ATTIC = {"id": "attic/T_i", "measurement": "mqtt", "tags": {"topic": "room1", "floor": "2"}, "unit": "degC"}


def source(*channels: dict[str, Any]) -> HttpSource:
    return TABLE.build("telegraf", [bound(TABLE, **one) for one in channels or (ROOM, ROOF, HALL, METER, ATTIC)])


def names(readings: list[Reading]) -> list[str]:
    return [reading.channel for reading in readings]


@tabled
def test_a_line_means_the_channels_whose_measurement_field_and_tags_it_has(line: str, channels: list[str]) -> None:
    assert names(source().receive(list(from_lines(line, "ns")), None, NOW).readings) == channels


@tabled
def test_a_name_means_an_id_or_what_the_configuration_says(name: str, zone: str | None, channels: list[str]) -> None:
    assert names(source().receive([Posted(name, 5.0, NOW)], zone, NOW).readings) == channels


def test_a_pack_of_senml() -> None:
    pack = [
        {"bn": "office/", "bt": 1_772_000_000, "n": "T_i", "u": "Cel", "v": 21.5, "t": -5},
        {"n": "T_out", "u": "K", "v": 5},
        {"n": "T_out", "vs": "warm", "t": 1},
        {"n": "T_out", "t": 2},
    ]
    posted = list(from_senml(pack, NOW))
    names = [posted[0], Posted("a\nb\ud800", 1.0), Posted("m", 1.0, field="f"), Posted("x" * 10_000, 1.0)]
    assert [one.shown for one in names] == ["office/T_i", "a?b?", "m f", "x" * 80]
    readings = source().receive(posted, None, NOW).readings
    assert readings[0] == Reading("office/T_i", NOW - 5, 21.5)
    assert [reading.fault for reading in readings[1:]] == [Fault.WRONG_UNIT, Fault.NON_NUMERIC, Fault.NOT_AVAILABLE]


@tabled
def test_faults(value: float, late: float, unit: str | None, quality: str, fault: str | None) -> None:
    posted = Posted("roof", value, NOW + late, unit=unit, quality=Quality(quality))
    (reading,) = source(ROOF).receive([posted], None, NOW).readings
    assert reading.fault == fault
    assert (reading.quality == Quality.BAD) == (fault is not None)
    assert reading.time <= NOW + 10


def test_counts_become_power_in_the_order_of_their_times_and_once() -> None:
    counted = [Posted("office", kwh, NOW + at, "u_heat") for at, kwh in ((-30, 11.0), (-60, 10.5), (-90, 10.0))]
    meter = source(METER)
    received = meter.receive(counted, None, NOW)
    assert received.begun == 1
    assert [(reading.time - NOW, reading.value) for reading in received.readings] == [(-60, 60000.0), (-30, 60000.0)]
    assert {reading.fault for reading in meter.receive(counted, None, NOW).readings} == {Fault.OUT_OF_ORDER}
    (last,) = meter.receive([Posted("office", 11.5, NOW, "u_heat")], None, NOW).readings
    assert last.value == 60000.0, "what was posted twice has not moved the counter"


def test_counts_of_a_clock_that_was_set_back_do_not_stop_the_counter() -> None:
    posted = source()
    for ahead, count in ((7200, 100.0), (7260, 101.0)):
        posted.receive([Posted("office/u_heat", count)], None, NOW + ahead)
    first, second, third = (posted.receive([Posted("office/u_heat", 102.0 + k)], None, NOW + 60 * k) for k in range(3))
    assert (first.readings, first.begun) == ([], 1)
    found = [(one.time - NOW, one.value) for one in second.readings + third.readings]
    assert found == [(60, pytest.approx(60_000.0)), (120, pytest.approx(60_000.0))]
    # A publisher whose clock is ahead by less than what is allowed still repeats itself.
    again = posted.receive([Posted("office/u_heat", 104.0, NOW + 120)], None, NOW + 115)
    assert [one.fault for one in again.readings] == [Fault.OUT_OF_ORDER]


def test_a_channel_that_stays_through_a_reload_remembers_its_counter() -> None:
    meter = source(METER)
    meter.receive([Posted("office", 10.0, NOW - 60, "u_heat")], None, NOW)
    meter.rebind([bound(TABLE, **METER), bound(TABLE, **ROOF)])
    (reading,) = meter.receive([Posted("office", 10.5, NOW, "u_heat")], None, NOW).readings
    assert reading.value == 30000.0
    meter.rebind([bound(TABLE, **ROOF)])
    assert meter.receive([Posted("office", 11.0, NOW, "u_heat")], None, NOW).readings == []


async def test_its_batches_say_that_something_came_and_its_probe_where_to_look() -> None:
    posted_to = source(ROOF)
    batches = posted_to.batches(None)
    coming = asyncio.ensure_future(anext(batches))
    posted_to.receive([Posted("nobody", 5.0)], None, NOW)
    await asyncio.sleep(0)
    assert not coming.done()
    posted_to.receive([Posted("roof", 5.0)], None, NOW)
    assert (await coming) == ([], -inf)
    await batches.aclose()
    (probe,) = await posted_to.probe(1.0)
    assert "GET /zones/office" in probe.verdict
    assert posted_to.check() == []
    await posted_to.close()


def test_a_clock_that_is_a_little_ahead_dates_nothing_after_its_arrival() -> None:
    """Otherwise a value of a time to come would take the place of the one that is measured then."""
    posted = [Posted("office/T_i", 20.0 + k, NOW + when) for k, when in enumerate((2.0, 8.0, 60.0))]
    readings = source({"id": "office/T_i"}).receive(posted, None, NOW).readings
    assert [(one.time - NOW, one.fault) for one in readings] == [(-6.0, None), (0.0, None), (0.0, Fault.AHEAD_OF_TIME)]
