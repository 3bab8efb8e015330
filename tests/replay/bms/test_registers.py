"""What the registers hold, against bytes written out by hand and an independent decoder."""

import math
import struct
from typing import Any

import pytest
from support.tables import tabled

from replay.bms import register_map
from replay.bms.living.building import design
from replay.bms.plant import devices
from replay.bms.registers import Register, encode


def words(registers: str) -> list[int]:
    return [int(word, 16) for word in registers.split()]


@tabled
def test_words_are_those_written_out_by_hand(kind: str, order: str, value: float, registers: str) -> None:
    register = Register("holding", 0, kind, order)
    assert encode(register, value) == words(registers)
    assert encode(register, value, swapped=True) == words(registers)[::-1]


@tabled
def test_ends_of_ranges_sentinels_counters_and_bits(register: dict[str, Any], value: float, registers: str) -> None:
    assert encode(Register(**{"table": "input", "address": 0} | register), value) == words(registers)


def test_not_available_is_nan_in_floats_and_refused_where_nothing_can_say_it() -> None:
    found = encode(Register("holding", 0, "float32", "CDAB"), math.nan)
    assert math.isnan(struct.unpack(">f", struct.pack(">HH", *found[::-1]))[0])
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
