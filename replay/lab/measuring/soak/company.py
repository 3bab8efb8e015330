"""Who keeps the daemon company during a soak: streams that come, go and stop reading; listeners on Zenoh; faults."""

from __future__ import annotations

import asyncio
import os
import random
import signal
import socket
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import zenoh

from replay.lab.measuring.zenoh_session import loopback_session

FAULTS = ("freeze", "nan", "drift", "swapped-words", "slow", "silent", "drop", "window")
"""Kinds of faults of the simulated building that are switched on and off. Not "exception": what a device refuses is
asked for again after ten real minutes, so that in a soak every zone would soon have nothing to do."""

_DEAF = 0.3
"""Part of the streams that read nothing."""


class Company:
    """Restless clients of one daemon; `keep` runs them until it is cancelled."""

    def __init__(self, url: str, control: str, zenoh_port: int, zones: list[str], seed: int, breaks: bool) -> None:
        self.streams = 0
        """Open now."""
        self.opened = 0
        self.events = 0
        self.heard = 0
        """Messages on Zenoh."""
        self.faults = 0
        self.reloads = 0
        self._url, self._control, self._zones = url, control, zones
        self._zenoh_port = zenoh_port
        self._breaks = breaks
        self._choose = random.Random(seed)

    async def keep(self, process: int, streams: int) -> None:
        """Keep `streams` streams coming and going beside everything else; for ever."""
        async with asyncio.TaskGroup() as tasks:
            for _ in range(streams):
                tasks.create_task(self._stream())
            tasks.create_task(self._listen())
            if self._breaks:
                tasks.create_task(self._break())
            tasks.create_task(self._reload(process))

    async def _stream(self) -> None:
        """Open a stream of some zone, read for a while or not at all, leave without a word, come again."""
        address = urlsplit(self._url)
        while True:
            zone, reads = self._choose.choice(self._zones), self._choose.random() > _DEAF
            raw = socket.socket()
            raw.setblocking(False)
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            try:
                await asyncio.get_running_loop().sock_connect(raw, (address.hostname, address.port))
                reader, writer = await asyncio.open_connection(sock=raw, limit=4096)
            except OSError:
                raw.close()
                await asyncio.sleep(1.0)
                continue
            self.streams += 1
            self.opened += 1
            try:
                writer.write(f"GET /zones/{zone}/stream HTTP/1.1\r\nHost: {address.netloc}\r\n\r\n".encode())
                async with asyncio.timeout(self._choose.uniform(0.5, 20.0)):
                    while reads and (line := await reader.read(4096)):
                        self.events += line.count(b"event: ")
                    if not reads:
                        await asyncio.Event().wait()
            except (TimeoutError, OSError):
                pass
            finally:
                self.streams -= 1
                writer.close()
            await asyncio.sleep(self._choose.uniform(0.0, 2.0))

    async def _listen(self) -> None:
        """Open a session on Zenoh, subscribe to everything, leave, come again."""
        while True:
            session = await asyncio.to_thread(self._session)
            await asyncio.sleep(self._choose.uniform(2.0, 10.0))
            await asyncio.to_thread(session.close)
            await asyncio.sleep(self._choose.uniform(0.5, 5.0))

    def _session(self) -> zenoh.Session:
        session = loopback_session("client", self._zenoh_port)
        session.declare_subscriber("thermogate/**", self._hear)
        return session

    def _hear(self, sample: zenoh.Sample) -> None:
        self.heard += 1

    async def _break(self) -> None:
        """Switch a fault on for some s, now and then."""
        devices = [*self._zones, "weather"]
        async with httpx.AsyncClient(base_url=self._control, timeout=30.0) as client:
            while True:
                await asyncio.sleep(self._choose.uniform(1.0, 8.0))
                kind = self._choose.choice(FAULTS)
                device = self._choose.choice(self._zones if kind == "window" else devices)
                spec = {"kind": kind, "device": device, "for": self._choose.uniform(1.0, 10.0)}
                if (await client.post("/faults", json=spec)).status_code == httpx.codes.CREATED:
                    self.faults += 1

    async def _reload(self, process: int) -> None:
        """Send SIGHUP now and then, to a daemon that handles it."""
        while True:
            await asyncio.sleep(self._choose.uniform(10.0, 30.0))
            if _handles(process, signal.SIGHUP):
                os.kill(process, signal.SIGHUP)
                self.reloads += 1


def _handles(process: int, signum: int) -> bool:
    """Whether `process` has a handler for the signal, without which it would end."""
    status = Path(f"/proc/{process}/status").read_text(encoding="ascii")
    caught = next(line.split()[1] for line in status.splitlines() if line.startswith("SigCgt:"))
    return bool(int(caught, 16) >> (signum - 1) & 1)
