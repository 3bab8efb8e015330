"""The plant on BACnet/IP, read by the daemon's own source, with and without faults."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import aclosing
from typing import Any

import pytest

pytest.importorskip("bacpypes3", reason="bacpypes3 is not installed")

from support.bacnet_plant import free_udp_port
from support.bms_plant import Clock, simulation
from support.sources import bound, source_table
from support.waiting import PATIENCE

import adapters.bacnet.session
from adapters.bacnet.client import BacnetLink, Device, NoAnswer, Refused
from adapters.bacnet.objects import PRESENT_VALUE, STATUS_FLAGS, ObjectId
from adapters.bacnet.values import flags, number
from adapters.reading import Fault
from adapters.scanning import Scan
from replay.bms.bacnet.objects import CLIENT, FIRST_INSTANCE, objects
from replay.bms.bacnet.server import BacnetServer
from replay.bms.faults import parse_spec
from replay.bms.simulation import Simulation
from replay.errors import ReplayError

AIR = ObjectId(0, 1)


def network(port: int, **keys: Any) -> Any:
    return source_table("bacnet", interface=f"{CLIENT}/8", port=port, **keys)


def look(job: Callable[[BacnetLink, Simulation, int], Awaitable[Any]], **changes: Any) -> Any:
    """What `job` finds, with a link to a served plant whose clock stands still."""

    async def main() -> Any:
        plant = simulation(Clock(), **changes)
        server = await BacnetServer.start(plant, 0)
        link = BacnetLink(network(server.port, timeout=0.5, retries=0), lambda kind: None)
        try:
            await link.open()
            return await job(link, plant, server.port)
        finally:
            await link.close()
            await server.stop()

    return asyncio.run(main())


async def value(link: BacnetLink, device: Device, object: ObjectId = AIR) -> float | None:
    return number(await link.read_one(device, object, PRESENT_VALUE))


def test_every_channel_is_an_object_with_the_plants_value_and_unit() -> None:
    async def job(link: BacnetLink, plant: Simulation, port: int) -> None:
        found = await network(port, timeout=1.0).build("bms", []).scan(Scan(seconds=1.0))
        listed = {(row[0], row[2]): row for row in found.rows[1:]}
        expected = {
            (str(FIRST_INSTANCE + device.unit_id), f"{kind},{number}"): channel
            for device in plant.plant
            for channel, kind, number in objects(device)
        }
        assert listed.keys() == expected.keys()
        for place, row in listed.items():
            assert row[3] == expected[place].name
            assert row[5] in (expected[place].unit, "-")
        assert listed["1001", "analog-input,3"][5] == "degF"
        assert listed["1011", "accumulator,1"][4] == f"{2**32 - 500}"
        assert {row[6] for row in listed.values()} == {"ok"}

    look(job)


def test_faults_act_on_bacnet_too() -> None:
    async def job(link: BacnetLink, plant: Simulation, port: int) -> None:
        device = await link.find(1012, None)
        good = await value(link, device)
        plant.faults.add(parse_spec("nan:room2/T_air"))
        assert await value(link, device) == good, "the last value stays"
        assert flags(await link.read_one(device, AIR, STATUS_FLAGS)).fault
        plant.faults.clear()
        assert not flags(await link.read_one(device, AIR, STATUS_FLAGS)).fault
        plant.faults.add(parse_spec("exception:room2/T_air"))
        with pytest.raises(Refused, match="device error operational-problem"):
            await value(link, device)
        assert await value(link, device, ObjectId(0, 2)) is not None, "the others still answer"
        plant.faults.clear()
        plant.faults.add(parse_spec("silent:room2"))
        with pytest.raises(NoAnswer):
            await value(link, device)
        assert 1012 not in [found.instance for found in await link.who_is(0.3)]
        plant.faults.clear()
        plant.faults.add(parse_spec("slow:room2,value=0.2"))
        assert await value(link, device) == good

    look(job)


async def test_subscribers_are_told_of_changes_and_counters_are_polled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adapters.bacnet.session, "CONFIRM", 3600.0)
    plant = simulation(Clock(), pace=600.0)
    server = await BacnetServer.start(plant, 0)
    telling = asyncio.create_task(server.run())
    table = network(server.port, poll=0.05, device=1012)
    channels = [
        bound(table, "z/T", unit="degC", object="analog-input,1"),
        bound(table, "z/meter", unit="Wh", object="accumulator,1"),
    ]
    source = table.build("bms", channels)
    clock = plant._clock
    assert isinstance(clock, Clock)
    try:
        async with asyncio.timeout(PATIENCE), aclosing(source.batches(None)) as stream:
            first = {reading.channel: reading.value for reading in (await anext(stream)).readings}
            while not any(one.not_offered for one in source._sessions[1012].objects.values()):
                await anext(stream)
            clock.now += 60.0
            plant.catch_up()
            latest = dict(first)
            while latest["z/T"] == first["z/T"] or latest["z/meter"] == first["z/meter"]:
                batch = await anext(stream)
                latest |= {reading.channel: reading.value for reading in batch.readings}
            followed = source._sessions[1012].objects.items()
            assert [str(object) for object, one in followed if one.renew is not None] == ["analog-input,1"]
            plant.faults.add(parse_spec("nan:room2/T_air"))
            while {reading.fault for reading in (await anext(stream)).readings} != {Fault.REPORTED_BAD, None}:
                pass
    finally:
        telling.cancel()
        await asyncio.gather(telling, return_exceptions=True)
        await server.stop()


async def test_nothing_can_be_written() -> None:
    from bacpypes3.apdu import ErrorPDU
    from bacpypes3.primitivedata import ObjectIdentifier
    from support.bacnet_plant import Peer

    server = await BacnetServer.start(simulation(Clock()), 0)
    stranger = Peer(77, server.port)
    await stranger.open()
    what = ObjectIdentifier(("analog-input", 1))
    try:
        with pytest.raises(ErrorPDU, match="write-access-denied"):
            await stranger.write_property(f"127.0.1.3:{server.port}", what, "present-value", 5.0)
    finally:
        await stranger.datagrams.close()
        await server.stop()


async def test_a_port_that_another_has_is_one_sentence() -> None:
    port = free_udp_port()
    server = await BacnetServer.start(simulation(Clock()), port)
    try:
        with pytest.raises(ReplayError, match=rf"--bacnet {port}: 127\.0\.1\.1:{port} cannot be used \(another"):
            await BacnetServer.start(simulation(Clock()), port)
    finally:
        await server.stop()
