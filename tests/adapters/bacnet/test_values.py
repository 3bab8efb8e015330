"""Application-tagged values as numbers, text, flags; names of objects and units."""

import math
import struct

import pytest

from adapters.bacnet.objects import TYPES, ObjectId, parse_object
from adapters.bacnet.units import differs, unit_of
from adapters.bacnet.values import Flags, Tagged, Unreadable, bits, flags, number, object_id, text, whole
from adapters.reading import Quality


@pytest.mark.parametrize(
    ("tagged", "value"),
    [
        (Tagged(4, struct.pack(">f", 21.5)), 21.5),
        (Tagged(5, struct.pack(">d", -3.25)), -3.25),
        (Tagged(2, b"\x01\x00"), 256.0),
        (Tagged(2, b"\xff" * 8), 2.0**64),
        (Tagged(3, b"\xff\x9c"), -100.0),
        (Tagged(9, b"\x01"), 1.0),
        (Tagged(1, b"", 1), 1.0),
        (Tagged(1, b"", 0), 0.0),
        (Tagged(0, b""), None),
    ],
)
def test_numbers_of_every_type(tagged, value):
    assert number(tagged) == value


def test_a_real_may_be_no_number():
    assert math.isnan(number(Tagged(4, b"\x7f\xc0\x00\x00")))
    assert number(Tagged(4, b"\x7f\x80\x00\x00")) == math.inf


@pytest.mark.parametrize(
    "tagged", [Tagged(4, b"\x00"), Tagged(5, b"\x00" * 4), Tagged(2, b""), Tagged(2, b"\x00" * 9), Tagged(7, b"\x0021")]
)
def test_what_is_no_number_is_refused(tagged):
    with pytest.raises(Unreadable):
        number(tagged)


@pytest.mark.parametrize(
    ("octets", "expected", "quality"),
    [
        (b"\x04\x00", Flags(), Quality.GOOD),
        (b"\x04\x80", Flags(in_alarm=True), Quality.GOOD),
        (b"\x04\x40", Flags(fault=True), Quality.BAD),
        (b"\x04\x20", Flags(overridden=True), Quality.UNCERTAIN),
        (b"\x04\x10", Flags(out_of_service=True), Quality.BAD),
        (b"\x00\xff", Flags(True, True, True, True), Quality.BAD),
        (b"\x00", Flags(), Quality.GOOD),
    ],
)
def test_status_flags_and_their_quality(octets, expected, quality):
    assert flags(Tagged(8, octets)) == expected
    assert expected.quality is quality


@pytest.mark.parametrize("octets", [b"", b"\x08\x00", b"\x03"])
def test_what_is_no_bit_string_is_refused(octets):
    with pytest.raises(Unreadable):
        bits(Tagged(8, octets))


def test_text_is_printable_and_short():
    assert text(Tagged(7, b"\x00Temp\xc3\xa9rature\n")) == "Température"
    assert text(Tagged(7, b"\x04" + "é".encode("utf-16-be"))) == "é"
    assert text(Tagged(7, b"\x05\xe9")) == "é"
    assert len(text(Tagged(7, b"\x00" + b"x" * 1000))) == 80
    with pytest.raises(Unreadable):
        text(Tagged(4, b"abcd"))


def test_whole_numbers_and_objects():
    assert whole(Tagged(9, b"\x3e")) == 62
    assert object_id(Tagged(12, struct.pack(">I", 2 << 22 | 7))) == (2, 7)
    with pytest.raises(Unreadable):
        whole(Tagged(4, b"\x00" * 4))
    with pytest.raises(Unreadable):
        object_id(Tagged(12, b"\x00"))


def test_objects_as_people_write_them():
    assert parse_object("analog-input,3") == ObjectId(0, 3)
    assert parse_object(" Analog-Value : 12 ") == ObjectId(2, 12)
    assert {str(parse_object(f"{name},1")) for name in TYPES} == {f"{name},1" for name in TYPES}
    assert str(ObjectId(200, 1)) == "200,1"
    for wrong in ("analog-input", "analog-input,", "analog-input,-1", "analog-input,4194303", "device,1", "x,1", ""):
        with pytest.raises(ValueError, match=r"analog-input,3|whole number"):
            parse_object(wrong)


def test_units_as_the_configuration_writes_them():
    assert [unit_of(number) for number in (62, 64, 48, 19, 95)] == ["degC", "degF", "kW", "kWh", "1"]
    assert unit_of(60_000) is None
    assert not differs(62, "degC")
    assert not differs(None, "degC"), "a device that states nothing"
    assert not differs(95, "degC"), "a device whose units were never entered"
    assert differs(64, "degC")
    assert differs(60_000, "degC")
