"""Registers to numbers, against register contents that were written down by hand from the IEEE 754 and two's complement
patterns of the numbers; nothing here packs a number."""

import math

import pytest

from adapters.modbus.codec import ORDERS, Format, decode, is_available

LONG = ["0000 1234 5678 9ABC", "9ABC 5678 1234 0000", "0000 3412 7856 BC9A", "BC9A 7856 3412 0000"]
# Number, type, and its registers in the four orders.
TABLE = [
    (3.1415927410125732, "float32", ["4049 0FDB", "0FDB 4049", "4940 DB0F", "DB0F 4940"]),
    (-21.5, "float32", ["C1AC 0000", "0000 C1AC", "ACC1 0000", "0000 ACC1"]),
    (math.pi, "float64", ["4009 21FB 5444 2D18", "2D18 5444 21FB 4009", "0940 FB21 4454 182D", "182D 4454 FB21 0940"]),
    (305419896, "int32", ["1234 5678", "5678 1234", "3412 7856", "7856 3412"]),
    (-2, "int32", ["FFFF FFFE", "FFFE FFFF", "FFFF FEFF", "FEFF FFFF"]),
    (4294967294, "uint32", ["FFFF FFFE", "FFFE FFFF", "FFFF FEFF", "FEFF FFFF"]),
    (20015998343868, "int64", LONG),
    (-256, "int64", ["FFFF FFFF FFFF FF00", "FF00 FFFF FFFF FFFF", "FFFF FFFF FFFF 00FF", "00FF FFFF FFFF FFFF"]),
    (20015998343868, "uint64", LONG),
    (-32767, "int16", ["8001", "8001", "0180", "0180"]),
    (32769, "uint16", ["8001", "8001", "0180", "0180"]),
    (215, "int16", ["00D7", "00D7", "D700", "D700"]),
]


def words(text):
    return [int(word, 16) for word in text.split()]


@pytest.mark.parametrize(
    ("number", "type", "order", "registers"),
    [(number, type, order, text) for number, type, texts in TABLE for order, text in zip(ORDERS, texts, strict=True)],
)
def test_every_type_in_every_order(number, type, order, registers):
    format = Format(type, order)
    assert format.registers == len(registers.split())
    assert decode(words(registers), format) == number


def test_a_bit_of_a_register_counts_from_the_least_significant():
    bits = {0: 1, 1: 0, 2: 1, 15: 1, 14: 0, None: 1}
    assert {bit: decode([0b1000_0000_0000_0101], Format("bool", "ABCD", bit)) for bit in bits} == bits


@pytest.mark.parametrize(
    ("registers", "format", "available"),
    [
        ("8000", Format("int16", not_available=(0x8000,)), False),
        ("8000", Format("int16", not_available=(-32768,)), False),
        ("0080", Format("int16", "BADC", not_available=(0x8000,)), False),
        ("7FFF", Format("int16", not_available=(0x8000,)), True),
        ("8000", Format("int16"), True),
        ("FFFF FFFF", Format("uint32", not_available=(0xFFFFFFFF,)), False),
        ("7FC0 0000", Format("float32", not_available=(math.nan,)), False),
        ("7FC0 0000", Format("float32", not_available=(0x8000,)), True),
        ("C61C 3C00", Format("float32", not_available=(-9999.0,)), False),
        ("41AC 0000", Format("float32", not_available=(math.nan, 0x8000, -9999.0)), True),
    ],
)
def test_values_that_stand_for_none(registers, format, available):
    assert is_available(words(registers), format) is available


def test_an_unsigned_counter_rolls_over_at_its_width():
    widths = {"uint16": 65536.0, "uint32": 2.0**32, "int32": None, "float32": None}
    assert {type: Format(type).rollover for type in widths} == widths
