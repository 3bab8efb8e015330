"""Load of the MQTT source: many topics at a steady pace through a real broker.

    python tests/integration/mqtt_load.py --seconds 600

Broker and publisher are processes of their own. Every message carries its number and its time. Printed are the
messages that were sent and missed, how late they came, the share of one processor that the reading process used, and
its resident memory at the beginning and at the end.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

import paho.mqtt.client as paho
from integration.command import command
from integration.load import SETTLING, Cost, Meter, beside
from support.broker import broker
from support.sources import bound, source_table

from adapters.mqtt.source import MqttSource

_LATEST = 60.0
"""Seconds that are waited for the last messages."""


@dataclass(frozen=True)
class Load:
    """What was measured."""

    topics: int
    rate: float
    """Messages a second on each topic."""
    sent: int
    missed: int
    doubled: int
    worst_delay: float
    """Longest time from a message's own time to its reading's delivery, in s."""
    cost: Cost

    @property
    def good(self) -> bool:
        """Whether no message was missed and memory has not grown."""
        return not self.missed and not self.cost.grew

    def lines(self) -> list[str]:
        """For a person."""
        return [
            f"{self.topics} topics at {self.rate:g} Hz for {self.cost.seconds:.0f} s",
            f"messages {self.sent}, missed {self.missed}, doubled {self.doubled}, worst delay {self.worst_delay:.2f} s",
            *self.cost.lines(),
        ]


def _publish(port: int, topics: int, rate: float, rounds: int, pipe: Connection) -> None:
    """Publish `rounds` numbers on every topic, at least once each, when the pipe says so; say when all are sent."""
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
        info.wait_for_publish(_LATEST)
    pipe.send(time.monotonic() - began)
    client.disconnect()
    client.loop_stop()


class _Ledger:
    """Counts what comes, topic by topic, without keeping it."""

    def __init__(self, topics: int) -> None:
        self.next = dict.fromkeys((f"z/c{k}" for k in range(topics)), 0)
        self.came = self.missed = self.doubled = 0
        self.worst_delay = 0.0

    async def take(self, source: MqttSource, ready: asyncio.Event) -> None:
        async for batch in source.batches(None):
            ready.set()
            now = time.time()
            for channel, when, value, _, fault in batch.readings:
                if fault is not None:
                    raise RuntimeError(f"{channel}: {fault}")
                self.came += 1
                skipped = int(value) - self.next[channel]
                self.missed += max(0, skipped)
                self.doubled += skipped < 0
                self.next[channel] = int(value) + 1
                self.worst_delay = max(self.worst_delay, now - when)


async def _measure(port: int, topics: int, rate: float, rounds: int, pipe: Connection) -> Load:
    table = source_table("mqtt", host="127.0.0.1", port=port, client_id="load", format="json", time="/time")
    source = table.build("load", [bound(table, f"z/c{k}", topic=f"load/{k}") for k in range(topics)])
    ledger, ready = _Ledger(topics), asyncio.Event()
    taking = asyncio.create_task(ledger.take(source, ready))
    async with asyncio.timeout(_LATEST):
        await ready.wait()
    meter = Meter()
    pipe.send(None)
    await asyncio.sleep(min(SETTLING, rounds / rate / 2))
    meter.settle()
    while not pipe.poll() and not taking.done():
        await asyncio.sleep(0.2)
    cost = meter.read()
    deadline = time.monotonic() + _LATEST
    while ledger.came < topics * rounds and not taking.done() and time.monotonic() < deadline:
        await asyncio.sleep(0.1)
    taking.cancel()
    (outcome,) = await asyncio.gather(taking, return_exceptions=True)
    await source.close()
    if not isinstance(outcome, asyncio.CancelledError):
        raise RuntimeError(f"the source failed: {outcome!r}")
    missed = ledger.missed + sum(rounds - following for following in ledger.next.values())
    return Load(topics, rate, topics * rounds, missed, ledger.doubled, ledger.worst_delay, cost)


def measure(topics: int, rate: float, seconds: float) -> Load:
    """Publish on `topics` topics at `rate` Hz for `seconds`, and take everything in."""
    rounds = max(1, int(seconds * rate))
    # By itself mosquitto lets 1,000 messages wait for a client, which is half a second of them here.
    settings = ("allow_anonymous true", "max_queued_messages 100000")
    with (
        TemporaryDirectory() as folder,
        broker(Path(folder), *settings) as site,
        beside(_publish, site.port, topics, rate, rounds) as pipe,
    ):
        return asyncio.run(_measure(site.port, topics, rate, rounds, pipe))


if __name__ == "__main__":
    sys.exit(command("load of the MQTT source", measure, topics=200, rate=10.0, seconds=600.0))
