"""Registers to numbers, against register contents that were written down by hand from the IEEE 754 and two's complement
patterns of the numbers; nothing here packs a number."""

from support.tables import tabled

from adapters.modbus.codec import ORDERS, Format, decode, is_available


def words(text):
    return [int(word, 16) for word in text.split()]


@tabled
def test_every_type_in_every_order(number, type, orders):
    for order, registers in zip(ORDERS, orders, strict=True):
        format = Format(type, order)
        assert format.registers == len(registers.split())
        assert decode(words(registers), format) == number, order


def test_a_bit_of_a_register_counts_from_the_least_significant():
    bits = {0: 1, 1: 0, 2: 1, 15: 1, 14: 0, None: 1}
    assert {bit: decode([0b1000_0000_0000_0101], Format("bool", "ABCD", bit)) for bit in bits} == bits


@tabled
def test_values_that_stand_for_none(registers, written, available):
    assert is_available(words(registers), Format(**written)) is available


def test_an_unsigned_counter_rolls_over_at_its_width():
    widths = {"uint16": 65536.0, "uint32": 2.0**32, "int32": None, "float32": None}
    assert {type: Format(type).rollover for type in widths} == widths
