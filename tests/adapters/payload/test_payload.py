"""Payloads: numbers, JSON and SenML as values with time and quality, and what is refused."""

import json
from math import isnan
from zoneinfo import ZoneInfo

import pytest
from support.sources import bound, source_table
from support.tables import tabled

from adapters.messages.decoding import Decoded, Rejected, decode, shown
from adapters.messages.inbox import Incoming
from adapters.messages.points import MessageChannel, MessageChannels
from adapters.payload.times import NaiveTime, parse_time
from adapters.reading import Fault, Quality

NOON = 1_768_478_400.0  # 2026-01-15T12:00:00Z
TABLE = source_table("zenoh", connect=["tcp/127.0.0.1:1"])


def form(format="json", **keys):
    """A channel that reads payloads written so."""
    return bound(TABLE, "z/T", key="k", format=format, **keys).channel


def senml(**settings):
    # Of a scaled value a device may state any unit.
    return form("senml", **({} if "unit" in settings else {"scale": 2.0}), **settings)


PLAIN = form("plain")
JSON = form(value="/present/value", time="/time", quality="/quality")


def one(payload, written=PLAIN):
    payload = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
    (entry,) = decode(payload, written, NOON)
    return entry


def document(value=21.5, time="2026-01-15T12:00:00Z", quality="good"):
    return {"present": {"value": value}, "time": time, "quality": quality}


NUMBERS = {b"21.5": 21.5, b" -3e2\n": -300.0, b"\xef\xbb\xbf7": 7.0, b"true": 1.0, b"False": 0.0, b"0": 0.0}


def test_a_plain_number():
    assert {payload: one(payload) for payload in NUMBERS} == {p: Decoded(number) for p, number in NUMBERS.items()}
    assert {one(payload).fault for payload in (b"", b" ", b"null", b"None")} == {Fault.NOT_AVAILABLE}
    assert isnan(one(b"nan").raw), "the edge refuses it"


@pytest.mark.parametrize(
    "payload", [b"warm", b"21,5", b"1_000", b"21 degC", b"\xff\xfe", b"[21.5]", b"0x1", "\uff12".encode()]
)
def test_what_is_not_a_number_is_refused_in_one_sentence(payload):
    refused = one(payload)
    assert refused.fault is Fault.NON_NUMERIC
    assert refused.sentence.startswith("is ") or "is not a number" in refused.sentence
    assert "\n" not in refused.sentence


@pytest.mark.parametrize("written", [form(value="/v"), senml()])
def test_a_key_that_is_there_twice_says_two_things_and_so_none(written):
    refused = one(b'{"n": "a", "v": 20, "v": 90}', written)
    assert refused == Rejected(Fault.NON_NUMERIC, "has the key 'v' twice; give it once")


@tabled
def test_documents_and_packs(payload, written, expected):
    assert one(payload, JSON if written is None else form(**written)) == Decoded(*expected)


@tabled
def test_json_that_is_refused(payload, fault):
    assert one(payload, JSON).fault == fault


@pytest.mark.parametrize("payload", [b"{", b"\xff", b"[" * 100_000, b"9" * 5000])
def test_what_is_no_json_or_none_that_a_computer_holds_is_refused(payload):
    assert one(payload, JSON).fault is Fault.NON_NUMERIC
    assert one(document(value=10**400), JSON).fault is Fault.NOT_FINITE


def test_qualities_are_what_the_operator_says():
    words = form(value="/v", quality="/q", good=[192, True], uncertain=["64"])
    found = [
        getattr(one({"v": 1, "q": word}, words), "quality", None) for word in (192, 192.0, "192", True, 64, "good")
    ]
    assert found == [*[Quality.GOOD] * 4, Quality.UNCERTAIN, None]


@tabled
def test_times_of_payloads(value, form, expected):
    assert parse_time(value, form, None, NOON) == expected


NO_TIMES = {
    "iso8601": ["2016-12-31T23:59:60Z", "0001-01-01", 5, ""],
    "epoch": [True, "", "nan", 10**400, "1_700_000_000", "\uff11"],
    "epoch_ms": [[], None],
}


@pytest.mark.parametrize(("form", "value"), [(form, value) for form, values in NO_TIMES.items() for value in values])
def test_what_is_no_time_is_refused(form, value):
    with pytest.raises(ValueError, match="has "):
        parse_time(value, form, None, NOON)


def test_local_times_need_a_zone_and_the_hour_that_comes_twice_is_the_one_that_is_near():
    berlin = ZoneInfo("Europe/Berlin")
    with pytest.raises(NaiveTime, match="give time_zone"):
        parse_time("2026-01-15T13:00:00", "iso8601", None, NOON)
    assert parse_time("2026-01-15T13:00:00", "iso8601", berlin, NOON) == NOON
    first = 1_792_888_200.0  # 2026-10-25T00:30:00Z, half past two in summer time
    assert parse_time("2026-10-25T02:30:00", "iso8601", berlin, first + 5) == first
    assert parse_time("2026-10-25T02:30:00", "iso8601", berlin, first + 3605) == first + 3600
    with pytest.raises(ValueError, match="spring skips"):
        parse_time("2026-03-29T02:30:00", "iso8601", berlin, NOON)


def test_base_fields_are_resolved_and_records_told_apart():
    pack = [
        {"bn": "room1/", "bt": NOON, "bu": "Cel", "bv": 20, "n": "T_air", "v": 1.5},
        {"n": "T_air", "t": 5, "v": 1.75},
        {"n": "relay", "u": "/", "vb": True},
        {"bn": "room2/", "bv": 0, "n": "T_air", "v": 18},
    ]
    twice = decode(json.dumps(pack).encode(), senml(record="room1/T_air"), NOON)
    assert twice == [Decoded(21.5, NOON), Decoded(21.75, NOON + 5)]
    assert one(pack, senml(record="room1/relay")).raw == 1.0
    assert one(pack, senml(record="room2/T_air")) == Decoded(18.0, NOON)


def test_a_bad_record_harms_no_other():
    pack = [{"n": "a", "v": "x"}, {"n": "a", "v": 2}, {"n": "a", "vs": "on"}, {"n": "a", "v": None}]
    found = [getattr(entry, "fault", None) for entry in decode(json.dumps(pack).encode(), senml(), NOON)]
    assert found == [Fault.NON_NUMERIC, None, Fault.NON_NUMERIC, Fault.NOT_AVAILABLE]


@tabled
def test_packs_that_cannot_be_understood(pack, gist):
    assert gist in one(pack, senml()).sentence
    assert "no computer" in one([{"n": "a", "v": 1, "bt": 10**400}], senml()).sentence
    assert "has a time that is not finite" in one(b'[{"v": 1, "t": 1e999}]', senml()).sentence


def test_another_unit_or_record_is_said_with_what_there_is():
    wrong = one([{"n": "a", "u": "K", "v": 293}], senml(unit="degC"))
    assert wrong == Rejected(Fault.WRONG_UNIT, 'has "a" in K, and the channel says degC')
    absent = one([{"bn": "room1/", "n": "T_air", "v": 1}], senml(record="T_air"))
    assert absent == Rejected(Fault.NOT_AVAILABLE, 'has no record "T_air"; it has room1/T_air')


def test_payloads_are_shown_short_and_on_one_line():
    assert shown(b"21.5") == "21.5"
    assert shown(b"a\nb\x00\xff") == r"a b \xff"
    assert len(shown(b"x" * 1000)) == 60


@pytest.mark.parametrize("time", [-1.0, -62135596801.0, -1e17])
def test_a_time_before_1970_is_refused_and_can_be_probed(time):
    binding = bound(TABLE, "z/T", key="k", format="json", time_format="epoch", value="/present/value", time="/time")
    payload = json.dumps(document(time=time)).encode()
    incoming = Incoming("k", payload, len(payload), None, NOON)
    (reading,) = MessageChannels("bms", [binding], TABLE).came("k", incoming)
    assert (reading.fault, reading.time) == (Fault.BAD_TIMESTAMP, NOON)
    probe = MessageChannel(binding, TABLE).look([incoming], "")
    assert probe.verdict.endswith("is dated before 1970; look at time_format")


@pytest.mark.parametrize(
    "payload",
    [
        document(quality="ok\nWARNING all is well\x1b[2J"),
        document(quality="\ud800" + "x" * 60_000),
        document(time="yesterday\u2028\r"),
        document(value="\ud800"),
        document(value="\x00warm"),
    ],
)
def test_what_a_publisher_writes_can_neither_break_nor_fill_the_log(payload):
    refused = one(payload, JSON)
    assert refused.sentence.isprintable()
    assert len(refused.sentence) <= 300
    refused.sentence.encode()
