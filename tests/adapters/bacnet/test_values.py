"""Values as the library decodes them: numbers, text, flags; names of objects and units."""

import pytest

pytest.importorskip("bacpypes3", reason="bacpypes3 is not installed")

from bacpypes3.primitivedata import Tag, TagClass
from support.tables import tabled

from adapters.bacnet import values
from adapters.bacnet.client import decoded
from adapters.bacnet.objects import TYPES, ObjectId, parse_object
from adapters.bacnet.units import differs, unit_of
from adapters.bacnet.values import Unreadable, known, whole


def read(kind, tag, octets, length=None):
    """What the function `kind` reads in `octets`, in hexadecimal, under an application tag."""
    data = bytes.fromhex(octets)
    found = decoded(Tag(TagClass.application, tag, len(data) if length is None else length, data))
    return getattr(values, kind)(found)


@tabled
def test_values_of_every_type(kind, tag, octets, value):
    found = read(kind, tag, octets)
    assert (list(found) if kind == "object_id" else found) == value
    assert [read("number", 1, "", length) for length in (0, 1)] == [0.0, 1.0]
    assert read("text", 7, f"00{b'x'.hex() * 1000}") == "x" * 80


@tabled
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
