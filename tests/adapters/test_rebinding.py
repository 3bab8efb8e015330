"""Live sources that are given other channels while they are at work: the connection and what is remembered stay."""

from contextlib import aclosing

import pytest
from support.modbus_plant import channel, plant, serving, source
from support.sources import bound, source_table, values

METER = {"unit": "Wh", "to": "W", "valid": (-1e12, 1e12)}
TABLE = source_table("modbus", host="127.0.0.1", first_register=0, type="uint16")


async def test_modbus_keeps_its_connection_and_what_a_counter_said() -> None:
    site = plant(holding=[100, 21, 7, 0])
    async with serving(site):
        bms = source(site.port, [channel("meter", 0, "uint16", **METER), channel("room", 1, "uint16")])
        async with aclosing(bms.batches(None)) as stream:  # type: ignore[type-var]
            first = await anext(stream)
            assert [reading.channel for reading in first.readings] == ["z/room"], "a counter's first is no power"
            site.registers[1, "holding"][0] = 110
            # The same channels as new objects, one gone and one new.
            bms.rebind([bound(TABLE, "z/meter", register=0, **METER), bound(TABLE, "z/other", register=2)])
            second = await anext(stream)
            power = pytest.approx(10 * 3600 / (second.now - first.now))
            assert values([second]) == {"z/meter": power, "z/other": 7.0}
            assert (await anext(stream)).readings[-1].channel == "z/other"
    assert site.connections == 1
    assert site.requests()[0] == (0, 2)
    assert site.requests()[-1] == (0, 3)
