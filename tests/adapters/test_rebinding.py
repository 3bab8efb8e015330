"""Live sources that are given other channels while they are at work: the connection and what is remembered stay."""

from __future__ import annotations

import asyncio
from contextlib import aclosing

import pytest
from support.modbus_plant import channel, plant, serving, source
from support.sources import bound, source_table
from support.zenoh_plant import endpoint, listening, session

METER = {"unit": "Wh", "to": "W", "valid": (-1e12, 1e12)}
TABLE = source_table("modbus", host="127.0.0.1", first_register=0, type="uint16")


def test_modbus_keeps_its_connection_and_what_a_counter_said() -> None:
    async def run() -> None:
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
                found = {reading.channel: reading.value for reading in second.readings}
                assert found == {
                    "z/meter": pytest.approx(10 * 3600 / (second.now - first.now)),
                    "z/other": 7.0,
                }
                assert (await anext(stream)).readings[-1].channel == "z/other"
        assert site.connections == 1
        assert site.requests()[0] == (0, 2)
        assert site.requests()[-1] == (0, 3)

    asyncio.run(run())


def test_modbus_forgets_silence_and_refusals_of_what_it_no_longer_reads() -> None:
    async def run() -> None:
        site = plant({1: [21], 2: [22]})
        site.silent.add(2)
        async with serving(site):
            both = [channel("one", 0), channel("two", 0, unit_id=2)]
            bms = source(site.port, both, timeout=0.1)
            async with aclosing(bms.batches(None)) as stream:  # type: ignore[type-var]
                await anext(stream)
                await anext(stream)
                bms.rebind([bound(TABLE, "z/one", register=0, type="int16")])
                asked = len(site.requests(2))
                for _ in range(3):
                    await anext(stream)
                assert len(site.requests(2)) <= asked + 1

    asyncio.run(run())


def test_zenoh_keeps_its_session_and_follows_its_keys() -> None:
    async def run() -> None:
        place = endpoint()
        table = source_table("zenoh", connect=[place], timeout=1.0)
        room, hall = (bound(table, f"z/{name}", key=f"bms/{name}") for name in ("room", "hall"))
        bms = table.build("bms", [room])

        def put() -> None:
            other.put("bms/room", "21.5")
            other.put("bms/hall", "18.5")

        with session(listen=place) as other:
            async with listening(bms) as heard:
                await heard.until(lambda: heard.values("z/room"), put)
                assert heard.values("z/hall") == []
                links = bms._link
                bms.rebind([room, hall])
                await heard.until(lambda: heard.values("z/hall"), put)
                bms.rebind([hall])
                # It looks once a second; what is still on its way comes first.
                await asyncio.sleep(1.5)
                before = len(heard.values("z/room"))
                count = len(heard.values("z/hall"))
                await heard.until(lambda: len(heard.values("z/hall")) > count + 3, put)
                assert len(heard.values("z/room")) == before
                assert bms._link is links
                assert heard.failures == []

    asyncio.run(run())
