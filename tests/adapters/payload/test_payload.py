"""Payloads: numbers, JSON and SenML as values with time and quality, and what is refused."""

import json
from math import isnan
from zoneinfo import ZoneInfo

import pytest
from support.sources import bound, source_table

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


PLAIN = form("plain")
JSON = form(value="/present/value", time="/time", quality="/quality")


def one(payload, written=PLAIN):
    payload = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
    (entry,) = decode(payload, written, NOON)
    return entry


@pytest.mark.parametrize(
    ("payload", "number"),
    [(b"21.5", 21.5), (b" -3e2\n", -300.0), (b"\xef\xbb\xbf7", 7.0), (b"true", 1.0), (b"False", 0.0), (b"0", 0.0)],
)
def test_a_plain_number(payload, number):
    assert one(payload) == Decoded(number)


@pytest.mark.parametrize("payload", [b"", b" ", b"null", b"None"])
def test_a_plain_payload_may_say_that_there_is_no_value(payload):
    assert one(payload).fault is Fault.NOT_AVAILABLE


@pytest.mark.parametrize("payload", [b"warm", b"21,5", b"1_000", b"21.5 degC", b"\xff\xfe", b"[21.5]", b"0x10"])
def test_what_is_not_a_number_is_refused_in_one_sentence(payload):
    refused = one(payload)
    assert isinstance(refused, Rejected)
    assert refused.fault is Fault.NON_NUMERIC
    assert refused.sentence.startswith("is ") or "is not a number" in refused.sentence
    assert "\n" not in refused.sentence


def test_nan_is_left_to_the_edge_which_refuses_it():
    assert isnan(one(b"nan").raw)


def document(value=21.5, time="2026-01-15T12:00:00Z", quality="good"):
    return {"present": {"value": value}, "time": time, "quality": quality}


def test_json_by_pointers():
    assert one(document(), JSON) == Decoded(21.5, NOON, False, Quality.GOOD)
    assert one(document(time="2026-01-15T13:00:00+01:00"), JSON).time == NOON
    assert one(document(quality=" Uncertain "), JSON).quality is Quality.UNCERTAIN
    assert one(document(value="21.5"), JSON).raw == 21.5
    assert one(document(value=True), JSON).raw == 1.0


def test_the_whole_document_can_be_the_value():
    assert one(21, form(value="")) == Decoded(21.0)


def test_no_time_and_no_quality_are_defined():
    assert one({"present": {"value": 3}}, JSON) == Decoded(3.0, None, False, Quality.UNCERTAIN)
    assert one(document(time=None, quality=None), JSON) == Decoded(21.5, None, False, Quality.UNCERTAIN)
    assert one(document(), form(value="/present/value")) == Decoded(21.5)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"value": None}, Fault.NOT_AVAILABLE),
        ({"value": [1]}, Fault.NON_NUMERIC),
        ({"value": {}}, Fault.NON_NUMERIC),
        ({"value": "warm"}, Fault.NON_NUMERIC),
        ({"value": 10**400}, Fault.NOT_FINITE),
        ({"quality": "fault"}, Fault.REPORTED_BAD),
        ({"quality": 0}, Fault.REPORTED_BAD),
        ({"time": "yesterday"}, Fault.BAD_TIMESTAMP),
        ({"time": NOON}, Fault.BAD_TIMESTAMP),
        ({"time": "2026-01-15T12:00:00"}, Fault.NAIVE_TIMESTAMP),
    ],
)
def test_json_that_is_refused(changes, fault):
    assert one(document(**changes), JSON).fault is fault


@pytest.mark.parametrize("payload", [b"{", b"\xff", b"[" * 100_000, b"9" * 5000, b'{"other": 1}', b"[]", b"3"])
def test_json_that_is_malformed(payload):
    assert one(payload, JSON).fault is Fault.NON_NUMERIC


def test_qualities_are_what_the_operator_says():
    words = form(value="/v", quality="/q", good=[192, True], uncertain=["64"])
    found = {word: one({"v": 1, "q": word}, words) for word in (192, 192.0, "192", 64)}
    assert [entry.quality for entry in found.values()] == [Quality.GOOD, Quality.GOOD, Quality.UNCERTAIN]
    assert one({"v": 1, "q": True}, words).quality is Quality.GOOD
    assert one({"v": 1, "q": "good"}, words).fault is Fault.REPORTED_BAD


@pytest.mark.parametrize(
    ("value", "form", "expected"),
    [
        (NOON, "epoch", NOON),
        (str(NOON), "epoch", NOON),
        (NOON * 1000, "epoch_ms", NOON),
        ("2026-01-15 12:00:00.250Z", "iso8601", NOON + 0.25),
    ],
)
def test_times_of_payloads(value, form, expected):
    assert parse_time(value, form, None, NOON) == expected


NO_TIMES = {
    "iso8601": ["2016-12-31T23:59:60Z", "0001-01-01", 5, ""],
    "epoch": [True, "", "nan", 10**400],
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


def senml(**settings):
    # Of a scaled value a device may state any unit.
    return form("senml", **({} if "unit" in settings else {"scale": 2.0}), **settings)


def test_base_fields_are_resolved_and_records_told_apart():
    pack = [
        {"bn": "room1/", "bt": NOON, "bu": "Cel", "bv": 20, "n": "T_air", "v": 1.5},
        {"n": "T_air", "t": 5, "v": 1.75},
        {"n": "relay", "u": "/", "vb": True},
        {"bn": "room2/", "bv": 0, "n": "T_air", "v": 18},
    ]
    assert decode(json.dumps(pack).encode(), senml(record="room1/T_air"), NOON) == [
        Decoded(21.5, NOON),
        Decoded(21.75, NOON + 5),
    ]
    assert one(pack, senml(record="room1/relay")).raw == 1.0
    assert one(pack, senml(record="room2/T_air")) == Decoded(18.0, NOON)


def test_times_below_two_to_the_28_are_relative_and_none_is_none():
    assert one([{"n": "a", "v": 1, "t": -30}], senml()) == Decoded(1.0, -30.0, True)
    assert one([{"n": "a", "v": 1}], senml()) == Decoded(1.0, None)
    assert one({"n": "a", "v": 1, "t": NOON}, senml()) == Decoded(1.0, NOON), "a record alone will do"


def test_a_base_value_alone_is_a_value():
    assert one([{"n": "a", "bv": 7.5}], senml()).raw == 7.5
    assert one([{"bn": "a/", "bv": 7.5}, {"n": "b", "v": 1}], senml()).raw == 8.5, "base fields alone are no record"


def test_the_unit_that_a_record_states_must_be_the_channels():
    assert one([{"n": "a", "u": "Cel", "v": 20}], senml(unit="degC")).raw == 20
    assert one([{"n": "a", "v": 20}], senml(unit="degC")).raw == 20
    refused = one([{"n": "a", "u": "K", "v": 293}], senml(unit="degC"))
    assert refused == Rejected(Fault.WRONG_UNIT, 'has "a" in K, and the channel says degC')


def test_a_bad_record_harms_no_other():
    pack = [{"n": "a", "v": "x"}, {"n": "a", "v": 2}, {"n": "a", "vs": "on"}, {"n": "a", "v": None}]
    found = decode(json.dumps(pack).encode(), senml(), NOON)
    assert [getattr(entry, "fault", None) for entry in found] == [
        Fault.NON_NUMERIC,
        None,
        Fault.NON_NUMERIC,
        Fault.NOT_AVAILABLE,
    ]


@pytest.mark.parametrize(
    ("pack", "gist"),
    [
        ([1], "no object"),
        ("x", "no SenML pack"),
        ([{"n": "a", "v": 1, "t": "x"}], '"t" that is no number'),
        ([{"n": "a", "v": 1, "bt": 10**400}], "no computer"),
        ([{"bver": 11, "n": "a", "v": 1}], "version 11"),
        ([{"n": "a", "v": 1, "new_": 1}], "must be understood"),
        ([{"n": "a", "v": 1}, {"n": "b", "v": 1}], "give record, one of a, b"),
        ([{"n": "a", "bv": 1, "v": "x"}], "not a number"),
    ],
)
def test_packs_that_cannot_be_understood(pack, gist):
    assert gist in one(pack, senml()).sentence


def test_a_record_that_is_not_there_is_said_with_those_that_are():
    refused = one([{"bn": "room1/", "n": "T_air", "v": 1}], senml(record="T_air"))
    assert refused == Rejected(Fault.NOT_AVAILABLE, 'has no record "T_air"; it has room1/T_air')


def test_payloads_are_shown_short_and_on_one_line():
    assert shown(b"21.5") == "21.5"
    assert shown(b"a\nb\x00\xff") == r"a b \xff"
    assert len(shown(b"x" * 1000)) == 60


@pytest.mark.parametrize(
    "pack", [b'[{"v": 1, "t": 1e999}]', b'[{"v": 1, "bt": 1e308, "t": 1e308}]', b'[{"v": 1, "t": NaN}]']
)
def test_a_senml_time_that_is_not_finite_is_refused(pack):
    assert one(pack, senml()).fault is Fault.BAD_TIMESTAMP


@pytest.mark.parametrize("time", [-1.0, -62135596801.0, -1e17])
def test_a_time_before_1970_is_refused_and_can_be_probed(time):
    binding = bound(TABLE, "z/T", key="k", format="json", time_format="epoch", value="/present/value", time="/time")
    payload = json.dumps(document(time=time)).encode()
    incoming = Incoming("k", payload, len(payload), None, NOON)
    (reading,) = MessageChannels("bms", [binding], TABLE).came("k", [incoming])
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
    assert isinstance(refused, Rejected)
    assert refused.sentence.isprintable()
    assert len(refused.sentence) <= 300
    refused.sentence.encode()
