"""Values as the library decodes them: numbers, text, flags; names of objects and units."""

import math
import struct

import pytest

pytest.importorskip("bacpypes3", reason="bacpypes3 is not installed")

from bacpypes3.primitivedata import Tag, TagClass

from adapters.bacnet.client import decoded
from adapters.bacnet.objects import TYPES, ObjectId, parse_object
from adapters.bacnet.units import differs, unit_of
from adapters.bacnet.values import Unreadable, bits, known, number, object_id, text, whole


def read(kind, tag, octets, length=None):
    """What `kind` reads in `octets` under an application tag."""
    return kind(decoded(Tag(TagClass.application, tag, len(octets) if length is None else length, octets)))


@pytest.mark.parametrize(
    ("kind", "tag", "octets", "value"),
    [
        (number, 4, struct.pack(">f", 21.5), 21.5),
        (number, 4, b"\x7f\x80\x00\x00", math.inf),
        (number, 5, struct.pack(">d", -3.25), -3.25),
        (number, 2, b"\xff" * 8, 2.0**64),
        (number, 3, b"\xff\x9c", -100.0),
        (number, 9, b"\x01", 1.0),
        (number, 0, b"", None),
        (text, 7, b"\x00Temp\xc3\xa9rature\n", "Température"),
        (text, 7, b"\x04" + "é".encode("utf-16-be"), "é"),
        (text, 7, b"\x05\xe9", "é"),
        (text, 7, b"\x00" + b"x" * 1000, "x" * 80),
        (whole, 9, b"\x3e", 62),
        (object_id, 12, struct.pack(">I", 2 << 22 | 7), (2, 7)),
    ],
)
def test_values_of_every_type(kind, tag, octets, value):
    assert read(kind, tag, octets) == value
    assert [read(number, 1, b"", length) for length in (0, 1)] == [0.0, 1.0]


@pytest.mark.parametrize(
    ("kind", "tag", "octets"),
    [
        *((number, 2, octets) for octets in (b"", b"\xff" * 200)),
        *((number, tag, octets) for tag, octets in ((4, b"\x00"), (5, b"\x00" * 4), (7, b"\x0021"), (13, b"\x00"))),
        (bits, 8, b""),
        (text, 4, b"abcd"),
        (whole, 4, b"\x00" * 4),
        (object_id, 12, b"\x00"),
    ],
)
def test_what_is_something_else_is_refused(kind, tag, octets):
    with pytest.raises(Unreadable):
        read(kind, tag, octets)


def test_objects_as_people_write_them():
    assert parse_object("analog-input,3") == ObjectId(0, 3)
    assert parse_object(" Analog-Value : 12 ") == ObjectId(2, 12)
    assert {str(parse_object(f"{name},1")) for name in TYPES} == {f"{name},1" for name in TYPES}
    assert str(ObjectId(200, 1)) == "200,1"
    for wrong in ("analog-input", "analog-input,", "analog-input,-1", "analog-input,4194303", "device,1", "x,1", ""):
        with pytest.raises(ValueError, match=r"analog-input,3|whole number"):
            parse_object(wrong)


def test_units_as_the_configuration_writes_them():
    assert [unit_of(number) for number in (62, 64, 48, 19, 95, 60_000)] == ["degC", "degF", "kW", "kWh", "1", None]
    # A device may state nothing, or have units that were never entered.
    assert [differs(stated, "degC") for stated in (62, None, 95, 64, 60_000)] == [False, False, False, True, True]


def test_what_is_not_known_of_an_object_is_none():
    assert [known(whole, value) for value in (62, "62", ValueError("refused"))] == [62, None, None]
