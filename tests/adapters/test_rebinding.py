"""Live sources that are given other channels while they are at work: the connection and what is remembered stay."""

from __future__ import annotations

import asyncio
from contextlib import aclosing

import pytest
from support.modbus_plant import plant, serving
from support.zenoh_plant import endpoint, listening, session

from adapters.edge import Edge
from adapters.messages.points import MessageChannel
from adapters.modbus.client import Line
from adapters.modbus.codec import Format
from adapters.modbus.plan import Limits
from adapters.modbus.source import ModbusChannel, ModbusSource
from adapters.units import conversion
from adapters.zenoh.connection import Connection
from adapters.zenoh.source import Intake, ZenohSource

METER = Edge(conversion=conversion("Wh", "W"), valid=(-1e12, 1e12), counter=True, rollover=65536.0)


def register(name: str, address: int, edge: Edge = Edge()) -> ModbusChannel:  # noqa: B008 - a value, never changed
    return ModbusChannel(f"z/{name}", address, Format("uint16"), edge=edge, register=address)


def test_modbus_keeps_its_connection_and_what_a_counter_said() -> None:
    async def run() -> None:
        site = plant(holding=[100, 21, 7, 0])
        async with serving(site):
            line = Line(host="127.0.0.1", port=site.port, timeout=0.5, retries=0)
            meter, room = register("meter", 0, METER), register("room", 1)
            bms = ModbusSource("bms", line, [meter, room], poll=0.05, limits=Limits(gap=8))
            async with aclosing(bms.batches(None)) as stream:  # type: ignore[type-var]
                first = await anext(stream)
                assert [reading.channel for reading in first.readings] == ["z/room"], "a counter's first is no power"
                site.registers[1, "holding"][0] = 110
                # The same channels as new objects, one gone and one new.
                bms.rebind([register("meter", 0, METER), register("other", 2)])
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
            line = Line(host="127.0.0.1", port=site.port, timeout=0.1, retries=0)
            both = [register("one", 0), ModbusChannel("z/two", 0, Format("uint16"), unit=2)]
            bms = ModbusSource("bms", line, both, poll=0.05, limits=Limits())
            async with aclosing(bms.batches(None)) as stream:  # type: ignore[type-var]
                await anext(stream)
                await anext(stream)
                bms.rebind(both[:1])
                asked = len(site.requests(2))
                for _ in range(3):
                    await anext(stream)
                assert len(site.requests(2)) <= asked + 1

    asyncio.run(run())


def test_zenoh_keeps_its_session_and_follows_its_keys() -> None:
    async def run() -> None:
        place = endpoint()
        room, hall = MessageChannel("z/room", "bms/room"), MessageChannel("z/hall", "bms/hall")
        bms = ZenohSource("bms", Connection(connect=(place,), timeout=1.0), [room], Intake())

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
