"""The Modbus source against real servers on loopback: what it reads, what it survives, and that it never writes."""

import asyncio
import contextlib
import re
import struct
import time
from contextlib import aclosing

import pytest
from pymodbus.constants import ExcCodes
from pymodbus.framer import FramerType
from support.modbus_plant import READS, channel, plant, serving, source
from support.sources import becomes, collect, exhaust, values
from support.tables import tabled

import adapters.modbus.source
from adapters.errors import SourceUnavailable
from adapters.reading import Fault


async def polled(site, channels, enough=bool, **keys):
    """What `channels` have after batches that are `enough`."""
    async with serving(site):
        return values(await collect(source(site.port, channels, **keys), enough))


@contextlib.asynccontextmanager
async def answering(answer):
    """The port of a device that answers every request with the PDU that `answer` makes of it."""

    async def serve(reader, writer):
        with contextlib.suppress(OSError, asyncio.IncompleteReadError), contextlib.closing(writer):
            while True:
                request = await reader.readexactly(12)
                pdu = answer(request)
                writer.write(request[:4] + struct.pack(">H", len(pdu) + 1) + request[6:7] + pdu)

    async with await asyncio.start_server(serve, "127.0.0.1", 0) as server:
        yield server.sockets[0].getsockname()[1]


def all_of(count):
    """Whether so many channels have a value or a fault."""
    return lambda batches: len(values(batches)) == count


@pytest.mark.parametrize(
    ("transport", "framer"), [("tcp", FramerType.SOCKET), ("rtu-over-tcp", FramerType.RTU)], ids=["tcp", "rtu over tcp"]
)
async def test_all_tables_are_read_over_either_framing(transport, framer):
    async with serving(
        plant(holding=[215, 0x41AC, 0], input=[7, 0, 500], coil=[0b100], discrete=[0b10]), framer
    ) as site:
        channels = [
            channel("tenths", 0, scale=0.1),
            channel("float", 1, "float32"),
            channel("input", 2, "uint16", table="input"),
            channel("coil", 2, "bool", table="coil"),
            channel("discrete", 0, "bool", table="discrete"),
            channel("bit", 0, "bool", bit=1),
        ]
        before = time.time()
        batches = await collect(source(site.port, channels, transport=transport), all_of(6))
        for batch in batches:
            assert before <= batch.now <= time.time()
            assert {reading.time for reading in batch.readings} == {batch.now}
    numbers = {"z/tenths": 21.5, "z/float": 21.5, "z/input": 500.0}
    assert values(batches) == numbers | {"z/coil": 1.0, "z/discrete": 0.0, "z/bit": 1.0}
    assert {code for _, code, _, _ in site.asked} == READS


@tabled
async def test_a_poll_reads_in_batches_or_one_by_one(limits, requests):
    site = plant(holding=list(range(40)))
    await polled(site, [channel(f"c{k}", k) for k in (0, 1, 2, 9, 30)], all_of(5), **limits)
    assert [list(each) for each in site.requests()] == requests


@pytest.mark.parametrize(("registers", "requests"), [(125, [(0, 61)]), (2, [(0, 31), (60, 1)])])
async def test_bits_count_for_a_sixteenth_of_a_register(registers, requests):
    site, coils = plant(coil=[1] * 80), [channel(f"c{k}", 30 * k, "bool", table="coil") for k in range(3)]
    await polled(site, coils, all_of(3), fill_gaps=2, max_registers=registers)
    assert site.requests() == requests


async def test_a_refused_register_loses_its_channel_only_and_is_asked_for_again_now_and_then(monkeypatch, caplog):
    caplog.set_level("INFO")
    site = plant(holding=list(range(100, 120)))
    site.refused.add((1, "holding", 5))
    expected = {f"z/c{k}": 100.0 + k for k in range(8)}
    async with serving(site), aclosing(source(site.port, [channel(f"c{k}", k) for k in range(8)]).batches(None)) as it:
        await becomes(it, expected | {"z/c5": Fault.REFUSED_BY_DEVICE})
        assert site.requests()[:7] == [(0, 8), (0, 4), (4, 4), (4, 2), (4, 1), (5, 1), (6, 2)]
        del site.asked[:7]
        for _ in range(6):
            await anext(it)
        assert all(not address <= 5 < address + count for address, count in site.requests()), "it is remembered"
        assert caplog.text.count("refuses z/c5 (unit 1 holding 5): exception 2 (illegal data address)") == 1
    monkeypatch.setattr(adapters.modbus.source, "REFUSAL", 0.2)
    async with serving(site), aclosing(source(site.port, [channel(f"c{k}", k) for k in range(8)]).batches(None)) as it:
        await becomes(it, {"z/c5": Fault.REFUSED_BY_DEVICE})
        site.refused.clear()
        assert (await becomes(it, {"z/c5": 105.0}))["z/c5"] == expected["z/c5"]
        assert site.requests()[-1] == (0, 8), "one request again"
    assert "gives z/c5 (unit 1 holding 5) again" in caplog.text


@pytest.mark.parametrize("exception", [ExcCodes.DEVICE_FAILURE, ExcCodes.MEMORY_PARITY_ERROR])
async def test_a_failure_that_passes_costs_seconds_and_one_that_lasts_is_left_alone(exception, monkeypatch, caplog):
    """Exception 4 for 2.5 s had blinded a zone for ten minutes."""
    monkeypatch.setattr(adapters.modbus.source, "FAILURE", 0.05)
    site = plant(holding=[1, 2, 3])
    site.failing[1, "holding", 1] = exception
    site.refused.add((1, "holding", 2))
    bad = Fault.REFUSED_BY_DEVICE
    async with serving(site):
        bms = source(site.port, [channel(f"c{k}", k) for k in range(3)])
        async with aclosing(bms.batches(None)) as stream:
            assert await becomes(stream, {"z/c0": 1.0, "z/c1": bad, "z/c2": bad})
            for _ in range(4):
                await becomes(stream, {"z/c1": bad})
            assert bms._refusals[1, "holding", 1, 1].pause > 0.3, "it grows"
            site.failing.clear()
            await becomes(stream, {"z/c0": 1.0, "z/c1": 2.0})
    assert site.requests().count((2, 1)) == 1, "what is not there is not asked for meanwhile"
    assert caplog.text.count("cannot give z/c1") == 1
    assert f"exception {int(exception)}" in caplog.text


@pytest.mark.parametrize(("table", "code"), [("holding", 4), ("input", 3), ("holding", 1), ("coil", 2)])
async def test_an_answer_with_another_function_code_is_none(table, code):
    """Registers of another table would be taken for a temperature."""
    content = bytes([2]) + struct.pack(">H", 7777) if code in (3, 4) else bytes([1, 1])
    async with answering(lambda _: bytes([code]) + content) as port:
        bms = source(port, [channel("c", 0, "bool" if table == "coil" else "int16", table=table)], timeout=0.5)
        (probe,) = await bms.probe(1)
        with pytest.raises(SourceUnavailable, match="silent"):
            await exhaust(bms.batches(None))
    assert probe.value is None
    assert f"function code {code} instead of" in probe.verdict


@pytest.mark.parametrize("pdu", [bytes([3, 255, 0, 1]), bytes([0x83]), bytes([3]), bytes([0x55, 1])])
async def test_an_answer_that_breaks_the_protocol_is_told_as_that(pdu, caplog):
    async with answering(lambda _: pdu) as port:
        (probe,) = await source(port, [channel("c", 0)], timeout=0.5).probe(1)
    assert "cable" not in probe.verdict
    assert "no Modbus" in probe.verdict
    assert "data_received" not in caplog.text, "an answer that cannot be read is no fault of the connection"


async def test_a_silent_unit_does_not_hold_up_the_others(caplog):
    caplog.set_level("INFO")
    site = plant({1: [21], 2: [22], 3: [23]})
    site.silent.add(2)
    channels = [channel(f"c{k}", 0, unit_id=k) for k in (1, 2, 3)]
    async with serving(site), aclosing(source(site.port, channels, timeout=0.2).batches(None)) as stream:
        for _ in range(20):
            await anext(stream)
        assert len(site.requests(2)) <= 10, "it is left alone for a while that grows"
        site.silent.clear()
        await becomes(stream, {"z/c1": 21.0, "z/c2": 22.0, "z/c3": 23.0})
    assert caplog.text.count("unit 2 is silent: no answer within 0.2 s") == 1
    assert "unit 2 answers again" in caplog.text


async def test_a_busy_unit_is_silent_and_not_taken_apart():
    site = plant({1: [21, 5], 2: [22, 6]})
    site.exceptions[1] = ExcCodes.DEVICE_BUSY
    channels = [channel(f"c{unit}{k}", k, unit_id=unit) for unit in (1, 2) for k in (0, 1)]
    await polled(site, channels, lambda batches: len(batches) >= 3)
    assert set(site.requests(1)) == {(0, 2)}


async def test_a_dropped_connection_is_unavailable_and_the_next_call_goes_on():
    async with serving(plant(holding=[1, 2])) as site:
        bms = source(site.port, [channel("a", 0), channel("b", 1)])
        stream = bms.batches(None)
        assert values([await anext(stream)]) == {"z/a": 1.0, "z/b": 2.0}
        site.drop()
        with pytest.raises(SourceUnavailable, match="has closed the connection; check that the device is on"):
            await exhaust(stream)
        assert values(await collect(bms)) == {"z/a": 1.0, "z/b": 2.0}
        await bms.close()
        await bms.close()
        assert site.connections == 2


async def test_requests_keep_their_pause():
    async with serving(plant(holding=list(range(10)))) as site:
        bms = source(site.port, [channel(f"c{k}", k) for k in range(4)], batch=False, pause=0.1)
        found = await collect(bms, all_of(4))
    assert found[-1].now - found[0].now >= 0.29


async def test_a_request_is_repeated_before_it_is_given_up():
    site = plant({1: [5], 2: [6]})
    site.silent.add(1)
    await polled(site, [channel("a", 0, unit_id=1), channel("b", 0, unit_id=2)], timeout=0.1, retries=2)
    assert len(site.requests(1)) == 3


async def test_a_probe_shows_registers_values_and_what_else_they_might_be():
    site = plant({1: [0x0000, 0x41AC, 215, 0x8000, 50], 2: [1]})
    site.refused.add((1, "holding", 4))
    site.silent.add(2)
    async with serving(site):
        channels = [
            channel("swapped", 0, "float32", unit="degC"),
            channel("tenths", 2, scale=0.1, unit="degC"),
            channel("absent", 3, not_available=[0x8000], unit="degC"),
            channel("refused", 4),
            channel("silent", 0, unit_id=2),
            channel("silent_too", 1, unit_id=2),
        ]
        meter = channel("meter", 2, "uint16", unit="kWh", to="W", scale=0.1)
        probes = await source(site.port, [*channels, meter], timeout=0.2).probe(1.0)
    swapped, tenths, absent, refused, silent, silent_too, meter = probes
    assert (swapped.raw, swapped.place) == ("0x0000 0x41ac", "unit 1 holding 0 float32 ABCD")
    assert swapped.verdict.startswith("doubtful: nearly but not quite 0")
    assert "CDAB would be 21.5, which is plausible" in swapped.hints
    assert (tenths.value, tenths.raw, tenths.verdict) == (21.5, "0x00d7", "good")
    assert absent.verdict.startswith("not available")
    assert "exception 2 (illegal data address); check table and register" in refused.verdict
    assert silent.verdict == silent_too.verdict == "no answer within 0.2 s; check unit_id and the device"
    assert len(site.requests(2)) == 1, "a silent unit is asked once"
    stands, moved = meter.hints
    assert stands == "the counter stands at 21.5"
    # A busy machine may take longer than was asked for, and says so.
    assert re.fullmatch(r"it moved by 0 within \d+\.\d s", moved)
