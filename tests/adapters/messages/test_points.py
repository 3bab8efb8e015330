"""From samples to readings: what was had before, what a wrong clock has dated, and what a broker had kept."""

import json
from typing import Any

from support.sources import bound, source_table
from support.tables import tabled

from adapters.messages.inbox import Incoming
from adapters.messages.points import MessageChannels
from adapters.reading import Fault, Quality, Reading

NOW = 1_772_000_000.0
AHEAD = 7200.0
TOPIC = "home/room/T"
TABLE = source_table("mqtt", host="127.0.0.1")
PLAIN = {"id": "room/T", "topic": TOPIC}
DATED = PLAIN | {"format": "json", "value": "/value", "time": "/time", "time_format": "epoch"}
SENML = PLAIN | {"format": "senml"}
COUNTER = {"unit": "J", "to": "W"}
RELATIVE = '[{"n": "T", "v": 20, "t": -2}]'


def channels(*listed: dict[str, Any]) -> MessageChannels:
    return MessageChannels("bms", [bound(TABLE, **one) for one in listed], TABLE)


def came(arrived: float, payload: object = 20, retained: bool = False) -> Incoming:
    written = str(payload).encode()
    return Incoming(TOPIC, written, len(written), None, arrived, retained)


def dated(time: float, arrived: float) -> Incoming:
    return came(arrived, f'{{"value": 20, "time": {time}}}')


def readings(taken: MessageChannels, *samples: Incoming) -> list[Reading]:
    return [reading for sample in samples for reading in taken.came(TOPIC, sample)]


def times(taken: MessageChannels, *samples: Incoming) -> list[float]:
    return [reading.time for reading in readings(taken, *samples)]


@tabled
def test_the_order_of_preference_decides_on_the_time(
    times: list[str], payload: str | None, stamp: float | None, expected: object
) -> None:
    table = source_table("zenoh", connect=["tcp/127.0.0.1:1"], times=times)
    when = None if payload is None else NOW + float(payload)
    written = json.dumps({"value": 20, "time": when}).encode()
    listed = [bound(table, "room/T", key="k", format="json", time="/time", time_format="epoch")]
    incoming = Incoming("k", written, len(written), None if stamp is None else NOW + stamp, NOW)
    (reading,) = MessageChannels("bms", listed, table).came("k", incoming)
    assert (reading.fault or reading.time - NOW) == expected


def test_a_retained_value_with_a_time_is_as_old_as_it_says_and_a_relative_one_counts_from_a_stamp() -> None:
    assert times(channels(SENML), came(NOW, RELATIVE)._replace(stamp=NOW - 30)) == [NOW - 32]
    (reading,) = readings(channels(DATED), dated(NOW - 7200, NOW)._replace(retained=True))
    assert (reading.time, reading.quality) == (NOW - 7200, Quality.GOOD)


def test_a_clock_that_is_a_little_ahead_dates_nothing_after_its_arrival() -> None:
    """Otherwise a value of a time to come would take the place of the one that is measured then."""
    taken = channels(DATED, SENML | {"id": "room/x"})
    pack = f'[{{"bt": {NOW}, "v": 1}}, {{"t": 4, "v": 2}}]'
    assert times(channels(DATED), dated(NOW + 8, NOW)) == [NOW]
    assert [one.time for one in taken.came(TOPIC, came(NOW, pack)) if one.fault is None] == [NOW - 4, NOW]


def test_what_was_had_is_passed_over_when_the_session_is_opened_anew() -> None:
    taken = channels(DATED)
    assert times(taken, dated(NOW - 60, NOW)) == [NOW - 60]
    taken.start_again()
    assert times(taken, dated(NOW - 60, NOW + 30), dated(NOW - 30, NOW + 30)) == [NOW - 30]


def test_a_clock_that_is_set_back_before_the_session_is_opened_anew_silences_nobody() -> None:
    taken = channels(PLAIN)
    assert times(taken, came(NOW + AHEAD)) == [NOW + AHEAD]
    taken.start_again()
    minutes = [NOW + 60 * k for k in range(3)]
    assert times(taken, *(came(minute) for minute in minutes)) == minutes


def test_what_waited_at_the_broker_after_the_clock_was_set_back_counts() -> None:
    taken = channels(DATED)
    readings(taken, dated(NOW + AHEAD, NOW + AHEAD))
    assert times(taken, dated(NOW, NOW)) == [NOW]
    taken.start_again()
    assert times(taken, dated(NOW, NOW + 600), dated(NOW + 300, NOW + 600)) == [NOW + 300]


def test_a_counter_counts_on_after_the_clock_was_set_back() -> None:
    taken = channels(PLAIN | COUNTER)
    readings(taken, came(NOW + AHEAD, 1000))
    taken.start_again()
    found = readings(taken, came(NOW, 2000), came(NOW + 60, 2600), came(NOW + 120, 3800))
    assert [(reading.time, reading.value) for reading in found] == [(NOW + 60, 10.0), (NOW + 120, 20.0)]


def test_a_retained_value_with_a_relative_time_is_one_without_a_time() -> None:
    taken = channels(SENML)
    (first,) = readings(taken, came(NOW, RELATIVE, retained=True))
    assert (first.time, first.quality) == (NOW - 2, Quality.UNCERTAIN)
    (live,) = readings(taken, came(NOW + 60, RELATIVE))
    assert (live.time, live.quality) == (NOW + 58, Quality.GOOD)
    taken.start_again()
    assert readings(taken, came(NOW + AHEAD, RELATIVE, retained=True)) == []


def test_records_of_a_pack_are_put_in_order() -> None:
    pack = f'[{{"n": "T", "t": {NOW - 40}, "v": 60}}, {{"n": "T", "t": {NOW - 100}, "v": 0}}]'
    found = readings(channels(SENML | COUNTER), came(NOW, pack))
    assert [(reading.time, reading.value) for reading in found] == [(NOW - 40, 1.0)]


def test_a_place_whose_value_was_deleted_has_none() -> None:
    (reading,) = readings(channels(PLAIN), Incoming(TOPIC, None, 0, None, NOW))
    assert (reading.time, reading.fault) == (NOW, Fault.NOT_AVAILABLE)
