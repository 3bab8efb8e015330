"""The Modbus server, seen by a client that is not ours: values that live, and every fault of the menu."""

from __future__ import annotations

import asyncio
import math
import struct
import time
from collections.abc import Callable
from typing import Any

import pytest
from pymodbus.exceptions import ModbusIOException
from support.bms_plant import Clock, Look, room1, room2, served, simulation

from replay.bms.faults import parse_spec
from replay.bms.modbus_server import ModbusServer
from replay.errors import ReplayError


def on_modbus(**changes: Any) -> Callable[[Look], Callable[[], None]]:
    """A test of what a client sees of a served plant."""

    def decorate(look: Look) -> Callable[[], None]:
        def test() -> None:
            asyncio.run(seen(look, **changes))

        return test

    return decorate


async def seen(look: Look, **changes: Any) -> None:
    clock = Clock()
    plant = simulation(clock, **changes)
    async with served(plant) as client:
        await look(client, plant, clock)


@on_modbus()
async def test_what_is_read_is_the_truth_within_noise_and_resolution(client, plant, clock):
    clock.now += 60
    plant.catch_up()
    now = plant.world.now
    assert await room1(client) == pytest.approx(now.air[0], abs=0.25)
    assert await room2(client) == pytest.approx(now.air[1], abs=0.2)
    words = (await client.read_input_registers(200, count=3, device_id=13)).registers
    kelvin, watts = struct.unpack(">Hi", b"".join(word.to_bytes(2, "little") for word in words))
    assert kelvin / 100 - 273.15 == pytest.approx(now.air[2], abs=0.2)
    assert watts == round(now.power[2]) > 0
    words = (await client.read_holding_registers(10, count=4, device_id=1)).registers
    (fahrenheit,) = struct.unpack("<d", b"".join(word.to_bytes(2, "big") for word in words))
    assert (fahrenheit - 32) / 1.8 == pytest.approx(now.outdoor, abs=0.2)
    relay = (await client.read_coils(0, count=1, device_id=11)).bits[0]
    assert relay == (now.power[0] > 0)
    assert (await client.read_discrete_inputs(3, count=1, device_id=13)).bits[0] is True


@on_modbus()
async def test_values_move_as_time_passes(client, plant, clock):
    seen = []
    for _ in range(4):
        seen.append(await room2(client))
        clock.now += 30
        plant.catch_up()
    assert len(set(seen)) == 4
    low, high = (await client.read_holding_registers(104, count=2, device_id=12)).registers
    # The counter counts real time: what the simulated time took, divided by the pace.
    assert low + 65536 * high == pytest.approx(plant.world.now.energy[1] / 3600 / 60, abs=0.51)


async def test_time_moves_by_itself_at_the_pace_that_was_asked_for() -> None:
    plant = simulation(time.monotonic, pace=3600.0)
    async with served(plant) as client:
        living = asyncio.create_task(plant.run())
        before = await room2(client)
        while plant.world.elapsed < 1800:
            await asyncio.sleep(0.02)
        assert await room2(client) != before
        living.cancel()


def test_a_building_that_is_behind_says_how_far_and_catches_up() -> None:
    clock = Clock()
    plant = simulation(clock)
    clock.now += 120
    behind = plant.catch_up()
    assert behind == 120 * 60 - plant.world.elapsed > 0
    assert plant.catch_up() == 0
    assert plant.world.elapsed == 120 * 60


@pytest.mark.parametrize(
    ("function", "address", "unit", "code"),
    [
        ("read_input_registers", 5, 11, 2),
        ("read_input_registers", 0xFFFF, 12, 2),
        ("read_holding_registers", 0, 13, 2),
        ("read_coils", 0, 12, 2),
        ("read_input_registers", 0, 99, 11),
        ("read_exception_status", None, 11, 1),
    ],
)
def test_what_is_not_there_is_refused(function: str, address: int | None, unit: int, code: int) -> None:
    async def look(client, plant, clock):
        place = {} if address is None else {"address": address}
        response = await getattr(client, function)(**place, device_id=unit)
        assert response.isError()
        assert response.exception_code == code

    asyncio.run(seen(look))


@on_modbus()
async def test_nothing_can_be_written(client, plant, clock):
    before = (await client.read_holding_registers(0, device_id=11)).registers
    assert (await client.write_register(0, 1, device_id=11)).exception_code == 1
    assert (await client.write_coil(0, True, device_id=11)).exception_code == 1
    assert (await client.read_holding_registers(0, device_id=11)).registers == before


@on_modbus(meters=50)
async def test_devices_for_load_answer_a_whole_poll_at_once(client, plant, clock):
    first = [(await client.read_input_registers(0, count=100, device_id=unit)).registers for unit in (100, 149)]
    clock.now += 1
    plant.catch_up()
    second = (await client.read_input_registers(0, count=100, device_id=149)).registers
    assert [len(words) for words in (*first, second)] == [100, 100, 100]
    assert second != first[1]


@on_modbus()
async def test_a_taken_port_is_said_in_one_sentence(client, plant, clock):
    with pytest.raises(ReplayError, match=r"--port \d+: .* cannot be used"):
        await ModbusServer.start(plant, client.comm_params.port)


@on_modbus()
async def test_freeze_holds_the_value_and_lets_go(client, plant, clock):
    fault = plant.faults.add(parse_spec("freeze:room2/T_air"))
    frozen = await room2(client)
    for _ in range(3):
        clock.now += 60
        plant.catch_up()
        assert await room2(client) == frozen
    plant.faults.remove(fault.id)
    assert await room2(client) != frozen


@on_modbus()
async def test_exceptions_of_one_channel_leave_the_others_alone(client, plant, clock):
    plant.faults.add(parse_spec("exception:room2/heat_power,value=6"))
    assert (await client.read_holding_registers(102, count=2, device_id=12)).exception_code == 6
    assert (await client.read_holding_registers(100, count=8, device_id=12)).exception_code == 6
    assert not (await client.read_holding_registers(100, count=2, device_id=12)).isError()
    assert not (await client.read_input_registers(0, device_id=11)).isError()


@on_modbus()
async def test_slow_answers_come_late_and_each_under_its_own_number(client, plant, clock):
    plant.faults.add(parse_spec("slow:room1,value=0.3"))
    reader, writer = await asyncio.open_connection("127.0.0.1", client.comm_params.port)
    # Transaction 7 asks slow room 1 for input 0, then 8 asks room 2 for holding 107, without waiting.
    writer.write(bytes.fromhex("0007 0000 0006 0b 04 0000 0001"))
    await writer.drain()
    await asyncio.sleep(0.05)
    writer.write(bytes.fromhex("0008 0000 0006 0c 03 006b 0001"))
    first, second = await reader.readexactly(11), await reader.readexactly(11)
    assert (first[:2], first[6:8]) == (bytes([0, 7]), bytes([11, 4]))
    assert (second[:2], second[6:8]) == (bytes([0, 8]), bytes([12, 3]))
    writer.close()
    await writer.wait_closed()


@on_modbus()
async def test_a_late_answer_is_later_than_its_delay(client, plant, clock):
    plant.faults.add(parse_spec("slow:room1,value=0.2"))
    began = time.monotonic()
    assert not (await client.read_input_registers(0, device_id=11)).isError()
    assert time.monotonic() - began >= 0.2


@on_modbus()
async def test_a_silent_device_does_not_answer_and_others_do(client, plant, clock):
    plant.faults.add(parse_spec("silent:room1"))
    client.comm_params.timeout_connect = 0.2
    with pytest.raises(ModbusIOException):
        await client.read_input_registers(0, device_id=11)
    assert 10 < await room2(client) < 30


@on_modbus()
async def test_drop_closes_the_connection_and_a_new_one_may_be_made(client, plant, clock):
    fault = plant.faults.add(parse_spec("drop:room1"))
    reader, writer = await asyncio.open_connection("127.0.0.1", client.comm_params.port)
    writer.write(bytes.fromhex("0001 0000 0006 0b 04 0000 0001"))
    assert await reader.read() == b"", "the end of the stream"
    writer.close()
    await writer.wait_closed()
    assert 10 < await room2(client) < 30, "a connection of its own is not touched"
    plant.faults.remove(fault.id)
    assert 10 < await room1(client) < 30


@on_modbus()
async def test_no_value_is_nan_in_floats_and_the_sentinel_in_integers(client, plant, clock):
    plant.faults.add(parse_spec("nan"))
    assert math.isnan(await room2(client))
    assert (await client.read_input_registers(0, device_id=11)).registers == [0x8000]
    assert (await client.read_input_registers(200, count=3, device_id=13)).registers == [0xFFFF, 0xFF7F, 0xFFFF]
    # A set-point without a sentinel cannot say it, and goes on.
    assert (await client.read_holding_registers(0, device_id=11)).registers == [41]


@on_modbus()
async def test_swapped_words_change_places_in_long_values_only(client, plant, clock):
    right = (await client.read_holding_registers(100, count=2, device_id=12)).registers
    point = (await client.read_holding_registers(107, device_id=12)).registers
    plant.faults.add(parse_spec("swapped-words:room2"))
    assert (await client.read_holding_registers(100, count=2, device_id=12)).registers == right[::-1]
    assert (await client.read_holding_registers(107, device_id=12)).registers == point


@on_modbus()
async def test_drift_grows_with_real_time(client, plant, clock):
    plant.faults.add(parse_spec("drift:room2/T_air,value=-1.5"))
    before = await room2(client)
    clock.now += 120
    assert await room2(client) == pytest.approx(before - 3.0, abs=1e-4)


@on_modbus()
async def test_a_window_left_open_cools_the_room_itself(client, plant, clock):
    untouched = simulation(clock)
    plant.faults.add(parse_spec("window:room2,value=300"))
    clock.now += 60
    plant.catch_up()
    untouched.catch_up()
    assert await room2(client) < untouched.world.now.air[1] - 1
    assert plant.world.now.opening[1] >= 300


@on_modbus()
async def test_a_fault_of_the_schedule_comes_and_goes_by_itself(client, plant, clock):
    plant.faults.add(parse_spec("nan:room2,after=10s,for=5s"))
    seen = []
    for _ in range(4):
        seen.append(math.isnan(await room2(client)))
        clock.now += 5
    assert seen == [False, False, True, False]
    assert plant.faults.listed() == []
