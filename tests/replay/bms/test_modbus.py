"""The Modbus server, seen by a client that is not ours: values that live, and every fault of the menu."""

import asyncio
import math
import struct
import time
from collections.abc import Callable
from typing import Any

import pytest
from pymodbus.exceptions import ModbusIOException
from support.bms_plant import Clock, Look, room1, room2, served, simulation, started

from replay.bms.faults import parse_spec


def on_modbus(*faults: str) -> Callable[[Look], Callable[[], None]]:
    """A test of what a client sees of a served plant with `faults`."""

    def decorate(look: Look) -> Callable[[], None]:
        async def seen() -> None:
            clock, plant = started()
            for text in faults:
                plant.faults.add(parse_spec(text))
            async with served(plant) as client:
                await look(client, plant, clock)

        return lambda: asyncio.run(seen())

    return decorate


async def words(client: Any, kind: str, address: int, count: int, unit: int) -> list[int]:
    return (await getattr(client, f"read_{kind}_registers")(address, count=count, device_id=unit)).registers


def live(plant: Any, clock: Clock, seconds: float) -> None:
    clock.now += seconds
    plant.catch_up()


@on_modbus()
async def test_what_is_read_is_the_truth_within_noise_and_resolution(client, plant, clock):
    live(plant, clock, 60)
    now = plant.world.now
    assert await room1(client) == pytest.approx(now.air[0], abs=0.25)
    assert await room2(client) == pytest.approx(now.air[1], abs=0.2)
    third = await words(client, "input", 200, 3, 13)
    kelvin, watts = struct.unpack(">Hi", b"".join(word.to_bytes(2, "little") for word in third))
    assert kelvin / 100 - 273.15 == pytest.approx(now.air[2], abs=0.2)
    assert watts == round(now.power[2]) > 0
    weather = await words(client, "holding", 10, 4, 1)
    (fahrenheit,) = struct.unpack("<d", b"".join(word.to_bytes(2, "big") for word in weather))
    assert (fahrenheit - 32) / 1.8 == pytest.approx(now.outdoor, abs=0.2)
    assert (await client.read_coils(0, count=1, device_id=11)).bits[0] == (now.power[0] > 0)
    assert (await client.read_discrete_inputs(3, count=1, device_id=13)).bits[0] is True


@on_modbus()
async def test_values_move_as_time_passes(client, plant, clock):
    seen = []
    for _ in range(4):
        seen.append(await room2(client))
        live(plant, clock, 30)
    assert len(set(seen)) == 4
    low, high = await words(client, "holding", 104, 2, 12)
    # The counter counts real time: what the simulated time took, divided by the pace.
    assert low + 65536 * high == pytest.approx(plant.world.now.energy[1] / 3600 / 60, abs=0.51)


def test_a_building_that_is_behind_says_how_far_and_catches_up() -> None:
    clock, plant = started()
    clock.now += 120
    assert plant.catch_up() == 120 * 60 - plant.world.elapsed > 0
    assert plant.catch_up() == 0
    assert plant.world.elapsed == 120 * 60


@on_modbus()
async def test_what_is_not_there_is_refused_and_nothing_can_be_written(client, plant, clock):
    before = await words(client, "holding", 0, 1, 11)
    for function, place, unit, code in (
        ("read_input_registers", (5,), 11, 2),
        ("read_input_registers", (0xFFFF,), 12, 2),
        ("read_holding_registers", (0,), 13, 2),
        ("read_coils", (0,), 12, 2),
        ("read_input_registers", (0,), 99, 11),
        ("read_exception_status", (), 11, 1),
        ("write_register", (0, 1), 11, 1),
        ("write_coil", (0, True), 11, 1),
    ):
        response = await getattr(client, function)(*place, device_id=unit)
        assert (response.isError(), response.exception_code) == (True, code), function
    assert await words(client, "holding", 0, 1, 11) == before


@on_modbus()
async def test_freeze_holds_the_value_and_lets_go(client, plant, clock):
    fault = plant.faults.add(parse_spec("freeze:room2/T_air"))
    frozen = await room2(client)
    for _ in range(3):
        live(plant, clock, 60)
        assert await room2(client) == frozen
    plant.faults.remove(fault.id)
    assert await room2(client) != frozen


@on_modbus("exception:room2/heat_power,value=6")
async def test_exceptions_of_one_channel_leave_the_others_alone(client, plant, clock):
    for place, count, code in ((102, 2, 6), (100, 8, 6), (100, 2, None)):
        answer = await client.read_holding_registers(place, count=count, device_id=12)
        assert (answer.exception_code if answer.isError() else None) == code
    assert not (await client.read_input_registers(0, device_id=11)).isError()


@on_modbus("slow:room1,value=0.3")
async def test_slow_answers_come_late_and_each_under_its_own_number(client, plant, clock):
    reader, writer = await asyncio.open_connection("127.0.0.1", client.comm_params.port)
    began = time.monotonic()
    # Transaction 7 asks slow room 1 for input 0, then 8 asks room 2 for holding 107, without waiting.
    writer.write(bytes.fromhex("0007 0000 0006 0b 04 0000 0001"))
    await writer.drain()
    await asyncio.sleep(0.05)
    writer.write(bytes.fromhex("0008 0000 0006 0c 03 006b 0001"))
    first, second = await reader.readexactly(11), await reader.readexactly(11)
    assert time.monotonic() - began >= 0.3
    assert (first[:2], first[6:8]) == (bytes([0, 7]), bytes([11, 4]))
    assert (second[:2], second[6:8]) == (bytes([0, 8]), bytes([12, 3]))
    writer.close()
    await writer.wait_closed()


@on_modbus("silent:room1")
async def test_a_silent_device_does_not_answer_and_others_do(client, plant, clock):
    client.comm_params.timeout_connect = 0.2
    with pytest.raises(ModbusIOException):
        await client.read_input_registers(0, device_id=11)
    assert 10 < await room2(client) < 30


@on_modbus("drop:room1")
async def test_drop_closes_the_connection_and_a_new_one_may_be_made(client, plant, clock):
    reader, writer = await asyncio.open_connection("127.0.0.1", client.comm_params.port)
    writer.write(bytes.fromhex("0001 0000 0006 0b 04 0000 0001"))
    assert await reader.read() == b"", "the end of the stream"
    writer.close()
    await writer.wait_closed()
    assert 10 < await room2(client) < 30, "a connection of its own is not touched"
    plant.faults.clear()
    assert 10 < await room1(client) < 30


@on_modbus("nan")
async def test_no_value_is_nan_in_floats_and_the_sentinel_in_integers(client, plant, clock):
    assert math.isnan(await room2(client))
    assert await words(client, "input", 0, 1, 11) == [0x8000]
    assert await words(client, "input", 200, 3, 13) == [0xFFFF, 0xFF7F, 0xFFFF]
    # A set-point without a sentinel cannot say it, and goes on.
    assert await words(client, "holding", 0, 1, 11) == [41]


@on_modbus()
async def test_swapped_words_change_places_in_long_values_only(client, plant, clock):
    right, point = await words(client, "holding", 100, 2, 12), await words(client, "holding", 107, 1, 12)
    plant.faults.add(parse_spec("swapped-words:room2"))
    assert await words(client, "holding", 100, 2, 12) == right[::-1]
    assert await words(client, "holding", 107, 1, 12) == point


@on_modbus("drift:room2/T_air,value=-1.5")
async def test_drift_grows_with_real_time_and_other_errors_join_it(client, plant, clock):
    before = await room2(client)
    clock.now += 120
    assert await room2(client) == pytest.approx(before - 3.0, abs=1e-4)
    plant.faults.add(parse_spec("offset:room2/T_air"))
    plant.faults.add(parse_spec("factor:room2/T_air,value=-1"))
    assert await room2(client) == pytest.approx(1.0 - before, abs=1e-4)


@on_modbus("window:room2,value=300")
async def test_a_window_left_open_cools_the_room_itself(client, plant, clock):
    untouched = simulation(clock)
    live(plant, clock, 60)
    untouched.catch_up()
    assert await room2(client) < untouched.world.now.air[1] - 1
    assert plant.world.now.opening[1] >= 300


@on_modbus("nan:room2,after=10s,for=5s")
async def test_a_fault_of_the_schedule_comes_and_goes_by_itself(client, plant, clock):
    seen = []
    for _ in range(4):
        seen.append(math.isnan(await room2(client)))
        clock.now += 5
    assert seen == [False, False, True, False]
    assert plant.faults.listed() == []
