"""Loads of sources: many devices or topics at a steady pace, read by one event loop.

    python tests/integration/loads.py modbus|bacnet|mqtt --seconds 600

Devices, broker and publisher are processes of their own. Printed are the polls or messages and those that were missed,
the readings, the longest wait for one, the share of one processor that the reading process used, and its resident
memory at the beginning and at the end. `bacnet --polled` does without subscriptions.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

import paho.mqtt.client as paho
from integration.command import command
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice
from support.broker import broker
from support.modbus_plant import channel
from support.modbus_plant import source as modbus_source
from support.observed import resident_bytes
from support.processes import beside
from support.sources import bound, source_table

SETTLING = 3.0
"""Seconds before the measurement begins, in which every connection is made and every buffer filled once."""
PATIENCE = 120.0
"""How much longer than asked for is measured, where no poll has come to its end, and messages are waited for, s."""
MOST_GROWTH = 5.0
"""MB that memory may grow by; the arrival times that are kept for the report are part of it."""


@dataclass(frozen=True)
class Load:
    """What was measured."""

    about: str
    asked: int
    """Polls that were made, or messages that were sent."""
    missed: int
    """Polls that should have been made and were not, or messages that did not come."""
    readings: int
    expected: int
    """Readings that these polls or messages should have brought."""
    longest_wait: float
    """Between two answers of a device, or from a message's own time to its reading's delivery, s."""
    seconds: float
    cpu: float
    """Share of one processor."""
    memory_before: float
    memory_after: float
    """Resident memory in MB."""

    @property
    def good(self) -> bool:
        """Whether nothing was missed, every reading came, and memory has not grown."""
        grew = self.memory_after > self.memory_before + MOST_GROWTH
        return not self.missed and self.readings == self.expected and not grew

    def lines(self) -> list[str]:
        """For a person."""
        return [
            f"{self.about} for {self.seconds:.0f} s: {self.asked} asked for, {self.missed} missed",
            f"readings {self.readings} of {self.expected}, longest wait {self.longest_wait:.2f} s",
            f"processor {100 * self.cpu:.1f} % of one core",
            f"memory {self.memory_before:.1f} MB before, {self.memory_after:.1f} MB after",
        ]


class Meter:
    """Reads what this process costs since it was made."""

    def __init__(self) -> None:
        self._cpu, self._began, self._memory = time.process_time(), time.monotonic(), _resident_memory()

    @property
    def seconds(self) -> float:
        """Since it was made."""
        return time.monotonic() - self._began

    def read(self) -> tuple[float, float, float, float]:
        """The last four figures of a load."""
        took = self.seconds
        return took, (time.process_time() - self._cpu) / took, self._memory, _resident_memory()


def _resident_memory() -> float:
    return resident_bytes(os.getpid()) / 1e6


def received(pipe: Connection) -> Any:
    """What the process of devices says once they serve."""
    if not pipe.poll(60):
        raise RuntimeError("the simulated devices did not start within 60 s")
    return pipe.recv()


async def cancelled(tasks: Sequence[asyncio.Task[None]]) -> None:
    """End the tasks, none of which may have failed."""
    for task in tasks:
        task.cancel()
    outcomes = await asyncio.gather(*tasks, return_exceptions=True)
    failures = [outcome for outcome in outcomes if not isinstance(outcome, asyncio.CancelledError)]
    if failures:
        raise RuntimeError(f"{len(failures)} of {len(tasks)} sources failed: {failures[0]!r}")


async def follow_all(sources: Sequence[Any], devices: int, channels: int, seconds: float, poll: float) -> Load:
    """Read `sources` of so many devices, whose channels are "d<number>/...", for `seconds`."""
    arrivals: dict[str, list[float]] = {f"d{device}": [] for device in range(devices)}
    counts: list[int] = []

    async def follow(source: Any) -> None:
        async for batch in source.batches(None):
            counts.append(sum(reading.fault is None for reading in batch.readings))
            arrivals[batch.readings[0].channel.split("/")[0]].append(asyncio.get_running_loop().time())

    def late() -> int:
        return sum(source.late for source in sources)

    tasks = [asyncio.create_task(follow(source)) for source in sources]
    await asyncio.sleep(2 * poll + min(SETTLING, seconds))
    for kept in (*arrivals.values(), counts):
        kept.clear()
    before, meter = late(), Meter()
    await asyncio.sleep(seconds)
    # Of a few seconds on a busy machine, too, there is something to tell.
    while not all(arrivals.values()) and meter.seconds < seconds + PATIENCE:
        await asyncio.sleep(poll)
    cost, missed = meter.read(), late() - before
    await cancelled(tasks)
    polls = sum(map(len, arrivals.values()))
    missed += sum(max(0, int(cost[0] / poll) - len(arrived)) for arrived in arrivals.values())
    gaps = [later - earlier for arrived in arrivals.values() for earlier, later in pairwise(arrived)]
    about = f"{devices} devices x {channels} points each {poll:g} s"
    return Load(about, polls, missed, sum(counts), polls * channels, max(gaps, default=0.0), *cost)


def _serve_modbus(devices: int, registers: int, pipe: Connection) -> None:
    """Serve every device on a port of its own until the process is ended; the ports go through `pipe`."""

    async def serve() -> None:
        ports = []
        for device in range(devices):
            words = [200 + (7 * device + k) % 50 for k in range(registers)]
            simulated = SimDevice(1, simdata=[SimData(0, values=words, datatype=DataType.REGISTERS)])
            server = ModbusTcpServer(simulated, address=("127.0.0.1", 0))
            await server.serve_forever(background=True)
            ports.append(server.transport.sockets[0].getsockname()[1])
        pipe.send(ports)
        await asyncio.Event().wait()

    asyncio.run(serve())


def modbus(devices: int, registers: int, seconds: float, poll: float = 1.0) -> Load:
    """Poll `devices` devices with `registers` registers each every `poll` s for `seconds`."""

    async def read() -> Load:
        sources = []
        for device, port in enumerate(ports):
            channels = [channel("", k, id=f"d{device}/c{k}", scale=0.1, unit="degC") for k in range(registers)]
            sources.append(modbus_source(port, channels, timeout=3.0, retries=1, poll=poll))
        return await follow_all(sources, devices, registers, seconds, poll)

    with beside(_serve_modbus, devices, registers) as pipe:
        ports = received(pipe)
        return asyncio.run(read())


def _serve_bacnet(devices: int, objects: int, port: int, pipe: Connection) -> None:
    """Serve every device until the process is ended; every second a tenth of its values changes."""
    from support.bacnet_plant import Peer

    async def serve() -> None:
        peers = [Peer(1000 + device, port, 1 + device) for device in range(devices)]
        made = [[peer.add(f"analog-input,{k}", 20.0 + k / 10) for k in range(1, objects + 1)] for peer in peers]
        for peer in peers:
            await peer.server.ready()
        pipe.send(True)
        turn = 0
        while True:
            turn += 1
            for inputs in made:
                for one in inputs[turn % 10 :: 10]:
                    # By more than its COV increment.
                    one.presentValue = 20.0 + turn % 7
            await asyncio.sleep(1.0)

    asyncio.run(serve())


def bacnet(devices: int, objects: int, seconds: float, poll: float, polled: bool = False) -> Load:
    """Read `devices` devices with `objects` objects each for `seconds`; without subscriptions if they are `polled`."""
    from support.bacnet_plant import free_udp_port

    port = free_udp_port()

    async def read() -> Load:
        table = source_table("bacnet", interface="127.0.0.1/8", port=port, poll=poll, cov=not polled)
        channels = [
            bound(table, f"d{device}/c{k}", unit="degC", device=1000 + device, object=f"analog-input,{k}")
            for device in range(devices)
            for k in range(1, objects + 1)
        ]
        return await follow_all([table.build("bms", channels)], devices, objects, seconds, poll)

    with beside(_serve_bacnet, devices, objects, port) as pipe:
        received(pipe)
        return asyncio.run(read())


def _publish(port: int, topics: int, rate: float, rounds: int, pipe: Connection) -> None:
    """Publish `rounds` numbers with their times on every topic, at least once each, when the pipe says so; say when all
    are sent."""
    client = paho.Client(paho.CallbackAPIVersion.VERSION2)
    client.max_queued_messages_set(0)
    client.max_inflight_messages_set(200)
    client.connect("127.0.0.1", port)
    client.loop_start()
    pipe.recv()
    began = time.monotonic()
    for number in range(rounds):
        info = None
        for topic in range(topics):
            document = {"value": number, "time": datetime.now(UTC).isoformat()}
            info = client.publish(f"load/{topic}", json.dumps(document), qos=1)
        time.sleep(max(0.0, began + (number + 1) / rate - time.monotonic()))
    if info is not None:
        info.wait_for_publish(PATIENCE)
    pipe.send(True)
    client.disconnect()
    client.loop_stop()


def mqtt(topics: int, rate: float, seconds: float) -> Load:
    """Publish on `topics` topics at `rate` Hz for `seconds` through a real broker, and take everything in."""
    rounds = max(1, int(seconds * rate))
    following = dict.fromkeys((f"z/c{k}" for k in range(topics)), 0)
    """The number that comes next on each channel."""
    came = missed = 0
    longest = 0.0

    async def take(source: Any, ready: asyncio.Event) -> None:
        nonlocal came, missed, longest
        async for batch in source.batches(None):
            ready.set()
            for name, when, value, _, fault in batch.readings:
                if fault is not None:
                    raise RuntimeError(f"{name}: {fault}")
                came += 1
                missed += max(0, int(value) - following[name])
                following[name] = int(value) + 1
                longest = max(longest, time.time() - when)

    async def measure(port: int, pipe: Connection) -> Load:
        table = source_table("mqtt", host="127.0.0.1", port=port, client_id="load", format="json", time="/time")
        source = table.build("load", [bound(table, f"z/c{k}", topic=f"load/{k}") for k in range(topics)])
        ready = asyncio.Event()
        taking = asyncio.create_task(take(source, ready))
        await asyncio.wait_for(ready.wait(), PATIENCE)
        pipe.send(None)
        await asyncio.sleep(min(SETTLING, seconds / 2))
        meter = Meter()
        while not pipe.poll() and not taking.done():
            await asyncio.sleep(0.1)
        cost, deadline = meter.read(), time.monotonic() + PATIENCE
        while came < topics * rounds and not taking.done() and time.monotonic() < deadline:
            await asyncio.sleep(0.1)
        await cancelled([taking])
        await source.close()
        sent, left = topics * rounds, sum(rounds - number for number in following.values())
        return Load(f"{topics} topics at {rate:g} Hz", sent, missed + left, came, sent, longest, *cost)

    # By itself mosquitto lets 1,000 messages wait for a client, which is half a second of them here.
    settings = ("allow_anonymous true", "max_queued_messages 100000")
    with (
        TemporaryDirectory() as folder,
        broker(Path(folder), *settings) as site,
        beside(_publish, site.port, topics, rate, rounds) as pipe,
    ):
        return asyncio.run(measure(site.port, pipe))


PROGRAMS: dict[str, tuple[Callable[..., Load], dict[str, float]]] = {
    "modbus": (modbus, {"devices": 50, "registers": 100, "seconds": 600.0, "poll": 1.0}),
    "bacnet": (bacnet, {"devices": 20, "objects": 50, "seconds": 600.0, "poll": 10.0, "polled": False}),
    "mqtt": (mqtt, {"topics": 200, "rate": 10.0, "seconds": 600.0}),
}

if __name__ == "__main__":
    program, defaults = PROGRAMS[sys.argv.pop(1)]
    sys.exit(command("load of a source", program, **defaults))
