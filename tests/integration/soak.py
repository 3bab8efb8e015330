"""Simulated days of the real daemon with restless clients and faults.

    python tests/integration/soak.py --hours 96

Streams come, go and stop reading; Zenoh sessions come and go; REST clients ask; devices fail; SIGHUP reloads. What the
daemon holds is judged by slopes per simulated day after a warm-up.
"""

from __future__ import annotations

import asyncio
import os
import random
import signal
import socket
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

import httpx
import numpy as np
import zenoh
from integration.command import command
from scipy.stats import theilslopes
from support.bms_process import Bms
from support.harness import Daemon
from support.observed import Observation, clients, observe
from support.zenoh_plant import endpoint, open_session

FAULTS = ("freeze", "nan", "drift", "swapped-words", "slow", "silent", "drop", "window")
"""Kinds of faults of the simulated building that are switched on and off. Not "exception": what a device refuses is
asked for again after ten real minutes, so that in a soak every zone would soon have nothing to do."""
DEAF = 0.3
"""Part of the streams that read nothing."""
SMALL = [(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)]
"""A buffer that a stream which nobody reads fills soon."""
WARM_UP = 1 / 2
"""Part of the soak that is not judged: caches, pools and buffers fill."""
BY_DAY, BY_SAMPLES = "simulated day", "1,000 accepted samples"


class Limit(NamedTuple):
    """`figure` of an observation may grow by less than `most` over one `by`."""

    figure: str
    most: float
    by: str


LIMITS = (
    Limit("resident_mb", 1.0, BY_DAY),
    Limit("descriptors", 0.5, BY_DAY),
    Limit("threads", 0.5, BY_DAY),
    Limit("disk_mb", 1.0, BY_SAMPLES),
)


@dataclass(frozen=True)
class Soaked:
    """What came of a soak at `pace` simulated s per s."""

    pace: float
    observations: list[Observation]
    company: dict[str, int]
    """What the clients did, and how many `requests` were `not_answered`."""

    def slopes(self) -> dict[Limit, tuple[float, float, float]]:
        """Of each of LIMITS, Theil and Sen's slope, which a few peaks do not move, and its 95 % interval."""
        settled = self.observations[int(len(self.observations) * WARM_UP) :]
        over = {
            BY_DAY: np.array([one.elapsed for one in settled]) * self.pace / 86_400.0,
            BY_SAMPLES: np.array([one.samples for one in settled]) / 1000.0,
        }
        found = {}
        for limit in LIMITS:
            values = np.array([getattr(one, limit.figure) for one in settled], dtype=float)
            # Where little has changed there are so many ties that the bounds are not defined (NaN).
            with np.errstate(invalid="ignore"):
                slope, _, lower, upper = map(float, theilslopes(values, over[limit.by]))
            found[limit] = slope, lower, upper
        return found

    def exceeded(self) -> list[str]:
        """The figures that grow too fast."""
        return [limit.figure for limit, (slope, *_) in self.slopes().items() if slope >= limit.most]

    @property
    def good(self) -> bool:
        """Whether none does."""
        return not self.exceeded()

    def lines(self) -> list[str]:
        """For a person."""
        first, last = self.observations[int(len(self.observations) * WARM_UP)], self.observations[-1]
        slopes = [
            f"{limit.figure}: {slope:+.3f} per {limit.by} (95 %: {lower:+.3f} to {upper:+.3f}; limit {limit.most:g})"
            for limit, (slope, lower, upper) in self.slopes().items()
        ]
        return [
            f"{last.elapsed * self.pace / 3600:.0f} simulated hours in {last.elapsed:.0f} s; {last.samples:.0f} "
            f"samples, {last.overruns:.0f} overruns; {self.company}",
            *slopes,
            f"memory {first.resident_mb:.0f} MB after the warm-up, {last.resident_mb:.0f} MB at the end",
            f"EXCEEDED: {', '.join(self.exceeded()) or 'nothing'}",
        ]


def soak(
    hours: float = 96.0,
    pace: float = 600.0,
    zones: int = 4,
    seed: int = 1,
    *,
    particles: int = 3000,
    every: float = 2.0,
) -> Soaked:
    """Run the daemon on a building of `zones` rooms for `hours` of simulated time, and look at it `every` real s."""
    with TemporaryDirectory(prefix="thermogate-soak-") as name:
        folder, place = Path(name), endpoint()
        settings: dict[str, object] = {
            "zenoh.enabled": True,
            "zenoh.listen": [place],
            # As many checkpoints per sample as at the usual settings in real time, or more.
            "site.checkpoint_every": "20s",
            **{f"zones.{index}.estimator_options.particles": particles for index in range(zones)},
        }
        config = folder / "soak.toml"
        options = ("--zones", zones, "--pace", pace, "--seed", seed, "--zenoh", "off", "--write-config", config)
        with Bms(*options) as bms, Daemon(config, folder / "daemon.log", settings) as daemon:
            rooms = [*daemon.wait(lambda zones: all(zone["samples"] for zone in zones.values()))]
            company = Company(daemon, bms.control, place, rooms, seed)
            with clients(daemon.url(), rooms, 2, 0.2) as finish:
                seconds, state = hours * 3600.0 / pace, folder / "state"
                observations = asyncio.run(_watched(daemon, state, seconds, every, company))
                answers = finish()
            assert daemon.terminate() == 0, daemon.log()
    asked = {"requests": len(answers), "not_answered": sum(answer.status == 0 for answer in answers)}
    return Soaked(pace, observations, {**company.count, **asked})


async def _watched(daemon: Daemon, state: Path, seconds: float, every: float, company: Company) -> list[Observation]:
    """Observations until the time is over, while the `company` is kept."""
    keeping = asyncio.create_task(company.keep())
    observations: list[Observation] = []
    began = time.monotonic()
    while (elapsed := time.monotonic() - began) < seconds:
        assert daemon.process.poll() is None, daemon.log()
        if keeping.done():
            keeping.result()
        observations.append(await asyncio.to_thread(observe, daemon, state, elapsed))
        await asyncio.sleep(max(0.0, began + len(observations) * every - time.monotonic()))
    keeping.cancel()
    await asyncio.gather(keeping, return_exceptions=True)
    return observations


class Company:
    """Restless clients of one daemon; `keep` runs them until it is cancelled, `count` has how much they did.

    `control` is the plant's surface, at which faults are switched on.
    """

    def __init__(self, daemon: Daemon, control: str, place: str, zones: list[str], seed: int) -> None:
        self.count = Counter(streams=0, events=0, messages=0, faults=0, reloads=0)
        self._daemon, self._control, self._place, self._zones = daemon, control, place, zones
        self._choose = random.Random(seed)

    async def keep(self) -> None:
        """Everything at once; for ever."""
        async with asyncio.TaskGroup() as tasks:
            for work in (*[self._stream] * 6, self._listen, self._reload, self._break):
                tasks.create_task(work())

    async def _pause(self, least: float, most: float) -> None:
        await asyncio.sleep(self._choose.uniform(least, most))

    async def _stream(self) -> None:
        """Open a stream of some zone, read for a while or not at all, leave without a word, come again."""
        while True:
            address = f"{self._daemon.url()}/zones/{self._choose.choice(self._zones)}/stream"
            reads, last = self._choose.random() > DEAF, self._choose.uniform(0.5, 20.0)
            try:
                async with (
                    asyncio.timeout(last),
                    httpx.AsyncClient(transport=httpx.AsyncHTTPTransport(socket_options=SMALL)) as client,
                    client.stream("GET", address, timeout=None) as answer,
                ):
                    self.count["streams"] += 1
                    if not reads:
                        await asyncio.Event().wait()
                    async for part in answer.aiter_bytes():
                        self.count["events"] += part.count(b"event: ")
            except (TimeoutError, httpx.HTTPError):
                pass
            await self._pause(0.0, 2.0)

    async def _listen(self) -> None:
        """Open a session on Zenoh, subscribe to everything, leave, come again."""

        def opened() -> zenoh.Session:
            session = open_session({"mode": "client", "connect/endpoints": [self._place]})
            session.declare_subscriber("thermogate/**", lambda sample: self.count.update(messages=1))
            return session

        while True:
            session = await asyncio.to_thread(opened)
            await self._pause(2.0, 10.0)
            await asyncio.to_thread(session.close)
            await self._pause(0.5, 5.0)

    async def _break(self) -> None:
        """Switch a fault on for some s, now and then."""
        async with httpx.AsyncClient(base_url=self._control, timeout=30.0) as client:
            while True:
                await self._pause(1.0, 8.0)
                kind = self._choose.choice(FAULTS)
                device = self._choose.choice(self._zones if kind == "window" else [*self._zones, "weather"])
                spec = {"kind": kind, "device": device, "for": self._choose.uniform(1.0, 10.0)}
                created = (await client.post("/faults", json=spec)).status_code == httpx.codes.CREATED
                self.count["faults"] += created

    async def _reload(self) -> None:
        """Send SIGHUP now and then."""
        while True:
            await self._pause(10.0, 30.0)
            os.kill(self._daemon.process.pid, signal.SIGHUP)
            self.count["reloads"] += 1


if __name__ == "__main__":
    sys.exit(command("a daemon under load for long", soak, hours=96.0, pace=600.0, zones=4, seed=1))
