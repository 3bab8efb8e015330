"""What `probe` doubts: values that are swapped, in a wrong order, of a wrong sign, or beside the right register."""

import asyncio
import struct

import pytest
from support.modbus_plant import channel, plant, serving, source
from support.sources import bound, source_table
from support.tables import tabled

from adapters.modbus.client import Answer
from adapters.modbus.points import ModbusChannel
from adapters.modbus.probing import probed

ROOM = {"type": "float32", "unit": "degC", "usual": (5.0, 40.0)}
HEATER = {"type": "float32", "unit": "kW", "to": "W", "usual": (-1e4, 1e4)}
METER = {"type": "float32", "unit": "kWh", "to": "W", "usual": (-1e4, 1e4)}


def words(kind, *values):
    packed = b"".join(struct.pack(kind, value) for value in values)
    return list(struct.unpack(f">{len(packed) // 2}H", packed))


def probe(registers, *channels, seconds=0.05, **tables):
    async def job():
        async with serving(plant(holding=registers, **tables)) as site:
            return await source(site.port, channels).probe(seconds)

    return asyncio.run(job())


def plausible(found):
    return [hint for hint in found.hints if "plausible" in hint]


def test_a_room_and_a_heater_that_are_swapped_are_doubted_and_each_is_named():
    registers = words(">f", 20.303, 1.8)
    room, heater = probe(registers, channel("T_i", 2, **ROOM), channel("u_heat", 0, **HEATER))
    assert (room.value, heater.value) == (pytest.approx(1.8), pytest.approx(20303.0))
    assert room.verdict == "doubtful: usually 5 to 40 here; if it is right, give valid"
    assert heater.verdict == "doubtful: usually -10000 to 10000 here; if it is right, give valid"
    assert "register 0 would be 20.303, which is plausible" in room.hints
    assert "register 2 would be 1800, which is plausible" in heater.hints
    right = probe(registers, channel("T_i", 0, **ROOM), channel("u_heat", 2, **HEATER))
    assert [(one.verdict, one.hints) for one in right] == [("good", ()), ("good", ())]


def test_scale_and_signedness_are_among_the_hints():
    (tenths,) = probe([215], channel("T_i", 0, **ROOM | {"type": "int16"}))
    assert plausible(tenths) == ["scale = 0.1 would be 21.5, which is plausible"]
    outdoors = ROOM | {"type": "uint16", "scale": 0.1, "usual": (-40.0, 50.0)}
    (frost,) = probe([0x10000 - 53], channel("T_out", 0, **outdoors))
    assert frost.verdict == "implausible: not within -60 to 80"
    assert "int16 would be -5.3, which is plausible" in frost.hints


def test_the_other_table_is_looked_at():
    (found,) = probe([0, 0], channel("T_i", 0, **ROOM), input=words(">f", 21.5))
    assert "table input would be 21.5, which is plausible" in found.hints


def test_a_register_that_is_a_number_of_a_list_from_40001_on():
    (found,) = probe([215] * 10, channel("T_i", 40101, **ROOM | {"type": "int16"}))
    assert found.verdict.startswith("the device refuses it: exception 2")
    assert (
        "a list that writes 40101 means register 101 of table holding: write first_register = 1, "
        'table = "holding" and register = 101'
    ) in found.hints


@tabled
def test_a_counter_is_read_twice(order, before, after, verdict):
    def read(value, when):
        return Answer(words(">I", value)[::-1], when)

    table = source_table("modbus", host="127.0.0.1", first_register=0)
    meter = ModbusChannel(bound(table, "z/u_heat", register=0, **METER | {"type": "uint32", "order": order}), table)
    found = probed(meter, read(before, 1000.0), read(after, 1005.0))
    assert found.verdict == verdict
    if order == "ABCD":
        assert f"CDAB would stand at {before:g}, which is plausible" in found.hints


@tabled
def test_a_float_counter_in_the_wrong_order_is_doubted(stand, verdict):
    (found,) = probe(words(">f", stand)[::-1], channel("u_heat", 0, **METER))
    assert found.verdict == verdict
    assert f"CDAB would stand at {stand:g}, which is plausible" in found.hints
