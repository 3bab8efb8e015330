"""What the registers hold, against bytes written out by hand and an independent decoder."""

import math
import struct

import pytest

from replay.bms import register_map
from replay.bms.living.building import design
from replay.bms.plant import devices
from replay.bms.registers import Register, encode

# The bytes of 123456.5 as IEEE 754 single are 47 F1 20 40; of 305419896 as an integer 12 34 56 78.
BY_HAND = [
    ("float32", "ABCD", 123456.5, [0x47F1, 0x2040]),
    ("float32", "CDAB", 123456.5, [0x2040, 0x47F1]),
    ("float32", "BADC", 123456.5, [0xF147, 0x4020]),
    ("float32", "DCBA", 123456.5, [0x4020, 0xF147]),
    ("uint32", "ABCD", 305419896, [0x1234, 0x5678]),
    ("uint32", "CDAB", 305419896, [0x5678, 0x1234]),
    ("int32", "BADC", 305419896, [0x3412, 0x7856]),
    ("int32", "DCBA", 305419896, [0x7856, 0x3412]),
    ("int32", "ABCD", -2, [0xFFFF, 0xFFFE]),
    ("int16", "ABCD", -2, [0xFFFE]),
    ("int16", "BADC", -2, [0xFEFF]),
    ("uint16", "BADC", 29415, [0xE772]),
    # The last byte is 0, for a double to hold the number exactly.
    ("uint64", "ABCD", 0x0102030405060800, [0x0102, 0x0304, 0x0506, 0x0800]),
    ("uint64", "CDAB", 0x0102030405060800, [0x0800, 0x0506, 0x0304, 0x0102]),
    ("int64", "BADC", 0x0102030405060800, [0x0201, 0x0403, 0x0605, 0x0008]),
    ("int64", "DCBA", 0x0102030405060800, [0x0008, 0x0605, 0x0403, 0x0201]),
    # 1.0 as IEEE 754 double is 3F F0 and six zeros.
    ("float64", "ABCD", 1.0, [0x3FF0, 0, 0, 0]),
    ("float64", "DCBA", 1.0, [0, 0, 0, 0xF03F]),
]
TENTHS = Register("input", 0, "int16", scale=0.1, sentinel=-0x8000)
COUNTER = Register("input", 0, "uint32", counter=True)


@pytest.mark.parametrize(("kind", "order", "value", "words"), BY_HAND)
def test_words_are_those_written_out_by_hand(kind: str, order: str, value: float, words: list[int]) -> None:
    register = Register("holding", 0, kind, order)
    assert encode(register, value) == words
    assert encode(register, value, swapped=True) == words[::-1]


@pytest.mark.parametrize(
    ("register", "value", "words"),
    [
        (TENTHS, -12.34, [0x10000 - 123]),
        (TENTHS, 1e6, [0x7FFF]),
        # The sentinel is never a value.
        (TENTHS, -1e6, [0x8001]),
        (TENTHS, math.nan, [0x8000]),
        (Register("input", 0, "uint16", sentinel=0xFFFF), 1e6, [0xFFFE]),
        (Register("input", 0, "uint16"), -5.0, [0]),
        (Register("input", 0, "int32", "BADC", sentinel=0x7FFFFFFF), math.nan, [0xFF7F, 0xFFFF]),
        (COUNTER, 2**32 - 1, [0xFFFF, 0xFFFF]),
        (COUNTER, 2**32 + 5, [0, 5]),
        (Register("coil", 0, "bool"), 1.0, [1]),
        (Register("coil", 0, "bool"), 0.0, [0]),
    ],
)
def test_ends_of_ranges_sentinels_counters_and_bits(register: Register, value: float, words: list[int]) -> None:
    assert encode(register, value) == words


def test_not_available_is_nan_in_floats_and_refused_where_nothing_can_say_it() -> None:
    words = encode(Register("holding", 0, "float32", "CDAB"), math.nan)
    assert math.isnan(struct.unpack(">f", struct.pack(">HH", *words[::-1]))[0])
    with pytest.raises(ValueError, match="cannot say"):
        encode(Register("holding", 0, "int16"), math.nan)


def test_registers_of_a_table_do_not_overlap_and_unit_ids_are_unique() -> None:
    plant = devices(design(80, 1), pace=1.0)
    assert len({device.unit_id for device in plant}) == len(plant)
    assert max(device.unit_id for device in plant) < 248
    for device in plant:
        assert len({channel.name for channel in device.channels}) == len(device.channels)
        for channel in device.channels:
            place = (channel.register.table, channel.register.address, channel.register.words)
            assert [other.name for other in device.channels if other.register.overlaps(*place)] == [channel.name]


def test_the_map_says_what_each_register_is() -> None:
    text = register_map.as_text(devices(design(2, 1), pace=1.0))
    assert text[0].split() == list(register_map.HEADINGS)
    assert text[1].split() == ["weather", "1", "T_out", "input", "0", "1", "int16", "ABCD", "0.1", "degC", "0x8000"]
