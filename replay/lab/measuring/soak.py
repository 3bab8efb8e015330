"""`make soak`: simulated days of the real daemon with restless clients and faults, and whether it stays as it is.

Streams come, go and stop reading; Zenoh sessions come and go; REST clients ask; devices fail; SIGHUP reloads. What the
daemon holds is judged by slopes per simulated day after a warm-up, against limits stated here.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import random
import shutil
import signal
import socket
import sys
import time
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import numpy as np
import zenoh
from scipy.stats import theilslopes

from replay.bms.background import in_background
from replay.bms.serving import BmsOptions, serve
from replay.bms.zenoh_publisher import opened
from replay.errors import ReplayError
from replay.lab.measuring.clients import Clients
from replay.lab.measuring.daemon import DaemonProcess, Observation, free_port, observe

FAULTS = ("freeze", "nan", "drift", "swapped-words", "slow", "silent", "drop", "window")
"""Kinds of faults of the simulated building that are switched on and off. Not "exception": what a device refuses is
asked for again after ten real minutes, so that in a soak every zone would soon have nothing to do."""
_DEAF = 0.3
"""Part of the streams that read nothing."""
_SMALL = [(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)]
"""A buffer that a stream which nobody reads fills soon."""
WARM_UP = 1 / 2
"""Part of the soak that is not judged: caches, pools and buffers fill."""
_DAY = 86_400.0
_BY_DAY, _BY_SAMPLES = "simulated day", "1,000 accepted samples"


class Limit(NamedTuple):
    """`figure` of an observation may grow by less than `most` `unit` over one `by`."""

    figure: str
    most: float
    unit: str
    by: str


LIMITS = (
    Limit("resident_mb", 1.0, "MB", _BY_DAY),
    Limit("descriptors", 0.5, "descriptors", _BY_DAY),
    Limit("threads", 0.5, "threads", _BY_DAY),
    Limit("disk_mb", 1.0, "MB", _BY_SAMPLES),
)


class Verdict(NamedTuple):
    """A slope with its 95 % interval, in `limit.unit` per `limit.by`."""

    limit: Limit
    slope: float
    lower: float
    upper: float

    @property
    def within(self) -> bool:
        """Whether it is within its limit."""
        return self.slope < self.limit.most

    def __str__(self) -> str:
        limit = self.limit
        return (
            f"{limit.figure}: {self.slope:+.3f} {limit.unit} per {limit.by} (95 %: {self.lower:+.3f} to "
            f"{self.upper:+.3f}; limit {limit.most:g}) {'within' if self.within else 'EXCEEDED'}"
        )


class Soak(NamedTuple):
    """What is run: `hours` of simulated time at `pace` simulated s per real s."""

    hours: float = 96.0
    pace: float = 600.0
    zones: int = 4
    particles: int = 3000
    every: float = 2.0
    """Real s between two looks at the daemon."""
    streams: int = 6
    clients: int = 2
    seed: int = 1
    polls: float | None = None
    """s from one look at the building's devices to the next; None: ten per sample."""
    faults: bool = True
    """Whether devices fail now and then."""


def run(soak: Soak, folder: Path) -> tuple[dict[str, Any], list[Observation]]:
    """Run `soak` in `folder`, which is empty or is made; figures and observations.

    Raises MeasurementError where the daemon ends before its time or does not stop in order.
    """
    folder.mkdir(parents=True, exist_ok=True)
    config, zenoh_port, control_port = folder / "soak.toml", free_port(), free_port()
    settings: dict[str, object] = {
        "http.port": 0,
        # As many checkpoints per sample as at the usual settings in real time, or more.
        "site.checkpoint_every": "20s",
        "zenoh.listen": [f"tcp/127.0.0.1:{zenoh_port}"],
        **{f"zones.{index}.estimator_options.particles": soak.particles for index in range(soak.zones)},
    }
    if soak.polls is not None:
        devices = ["weather", *(f"room{number}" for number in range(1, soak.zones + 1))]
        settings |= {f"sources.{device}.poll": soak.polls for device in devices}
    options = BmsOptions(
        zones=soak.zones,
        port=0,
        control_port=control_port,
        zenoh=None,
        pace=soak.pace,
        seed=soak.seed,
        config=config,
        overrides=[f"{key}={json.dumps(value)}" for key, value in settings.items()],
    )
    with in_background(partial(serve, options)), DaemonProcess(config, folder / "daemon.log") as daemon:
        url, control = daemon.url(), f"http://127.0.0.1:{control_port}"
        zones = [zone["id"] for zone in httpx.get(f"{url}/zones").json()["zones"]]
        company = _Company(url, control, zenoh_port, zones, soak.seed)
        with Clients(url, zones, soak.clients, pause=0.2) as clients:
            observations = asyncio.run(_watch(soak, daemon, folder / "state", url, company))
            answers = clients.finish()
        stopped = daemon.stop()
    asked = {"requests": len(answers), "not_answered": sum(answer.status == 0 for answer in answers)}
    found = summary(observations, soak.pace)
    return found | {"soak": soak._asdict(), "stop_s": stopped, "company": {**company.count, **asked}}, observations


async def _watch(soak: Soak, daemon: DaemonProcess, state_dir: Path, url: str, company: _Company) -> list[Observation]:
    """Observations every `every` s until the simulated time is over."""
    keeping = asyncio.create_task(company.keep(daemon.process.pid, soak))
    observations: list[Observation] = []
    began = time.monotonic()
    while (elapsed := time.monotonic() - began) < soak.hours * 3600.0 / soak.pace:
        daemon.check()
        if keeping.done():
            keeping.result()
        observations.append(await asyncio.to_thread(observe, daemon, state_dir, url, elapsed))
        await asyncio.sleep(max(0.0, began + len(observations) * soak.every - time.monotonic()))
    keeping.cancel()
    await asyncio.gather(keeping, return_exceptions=True)
    return observations


class _Company:
    """Restless clients of one daemon; `keep` runs them until it is cancelled, `count` says how much they did."""

    def __init__(self, url: str, control: str, zenoh_port: int, zones: list[str], seed: int) -> None:
        self.count = Counter(streams=0, events=0, messages=0, faults=0, reloads=0)
        self._url, self._control, self._zones, self._zenoh_port = url, control, zones, zenoh_port
        self._choose = random.Random(seed)

    async def keep(self, process: int, soak: Soak) -> None:
        """Streams that come and go beside everything else; for ever."""
        async with asyncio.TaskGroup() as tasks:
            for _ in range(soak.streams):
                tasks.create_task(self._stream())
            tasks.create_task(self._listen())
            if soak.faults:
                tasks.create_task(self._break())
            tasks.create_task(self._reload(process))

    async def _pause(self, least: float, most: float) -> None:
        await asyncio.sleep(self._choose.uniform(least, most))

    async def _stream(self) -> None:
        """Open a stream of some zone, read for a while or not at all, leave without a word, come again."""
        while True:
            address = f"{self._url}/zones/{self._choose.choice(self._zones)}/stream"
            reads, last = self._choose.random() > _DEAF, self._choose.uniform(0.5, 20.0)
            try:
                async with (
                    asyncio.timeout(last),
                    httpx.AsyncClient(transport=httpx.AsyncHTTPTransport(socket_options=_SMALL)) as client,
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
        while True:
            session = await asyncio.to_thread(self._session)
            await self._pause(2.0, 10.0)
            await asyncio.to_thread(session.close)
            await self._pause(0.5, 5.0)

    def _session(self) -> zenoh.Session:
        session = opened({"mode": "client", "connect/endpoints": [f"tcp/127.0.0.1:{self._zenoh_port}"]})
        session.declare_subscriber("thermogate/**", lambda sample: self.count.update(messages=1))
        return session

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

    async def _reload(self, process: int) -> None:
        """Send SIGHUP now and then."""
        while True:
            await self._pause(10.0, 30.0)
            os.kill(process, signal.SIGHUP)
            self.count["reloads"] += 1


def judge(observations: Sequence[Observation], pace: float) -> list[Verdict]:
    """A verdict for each of LIMITS, from Theil and Sen's slope, which a few peaks do not move.

    `pace`: simulated s per real s.
    """
    settled = observations[int(len(observations) * WARM_UP) :]
    over = {
        _BY_DAY: np.array([one.elapsed for one in settled]) * pace / _DAY,
        _BY_SAMPLES: np.array([one.samples for one in settled]) / 1000.0,
    }
    verdicts = []
    for limit in LIMITS:
        values = np.array([getattr(one, limit.figure) for one in settled], dtype=float)
        # Where little has changed there are so many ties that the bounds are not defined (NaN).
        with np.errstate(invalid="ignore"):
            slope, _, lower, upper = map(float, theilslopes(values, over[limit.by]))
        verdicts.append(Verdict(limit, slope, lower, upper))
    return verdicts


def summary(observations: Sequence[Observation], pace: float) -> dict[str, Any]:
    """The settled and the last values of what was observed, and the delay of the event loop."""
    first, last = observations[int(len(observations) * WARM_UP)], observations[-1]
    return {
        "simulated_hours": last.elapsed * pace / 3600.0,
        "after_warm_up": first._asdict(),
        "last": last._asdict(),
        "late_timers_share": (last.late_timers - first.late_timers) / max(last.timers - first.timers, 1.0),
        "cores_used": (last.cpu_s - first.cpu_s) / max(last.elapsed - first.elapsed, 1e-9),
    }


def lines(result: dict[str, Any], verdicts: Sequence[Verdict]) -> list[str]:
    """For a terminal."""
    last, done = result["last"], ", ".join(f"{count} {what}" for what, count in result["company"].items())
    return [
        f"{result['simulated_hours']:.0f} simulated hours in {last['elapsed']:.0f} s, {result['soak']['zones']} zones; "
        f"{last['samples']:.0f} samples, {last['overruns']:.0f} overruns",
        f"company: {done.replace('_', ' ')}",
        *map(str, verdicts),
        f"memory {result['after_warm_up']['resident_mb']:.0f} MB after the warm-up, {last['resident_mb']:.0f} MB at "
        f"the end; {100 * result['late_timers_share']:.2f} % of the timers more than 20 ms late; "
        f"{result['cores_used']:.2f} cores; stopped in {result['stop_s']:.1f} s",
    ]


def main() -> int:
    """Run the soak that the command line describes; 0 if everything stayed within its limits."""
    usual = Soak()
    parser = argparse.ArgumentParser(prog="python -m replay.lab.measuring.soak", description=__doc__)
    for name, meaning in (
        ("hours", "simulated"),
        ("pace", "simulated s per s, to 3600"),
        ("zones", "rooms"),
        ("seed", "of building, faults and clients"),
    ):
        default = getattr(usual, name)
        parser.add_argument(f"--{name}", type=type(default), default=default, help=f"{meaning} (default {default:g})")
    parser.add_argument("--out", type=Path, default=Path("var/soak"), help="folder, emptied first (default var/soak)")
    given = parser.parse_args()
    if given.hours <= 0 or not 1 <= given.pace <= 3600 or not 1 <= given.zones <= 80:
        parser.error("hours are above 0, pace is 1 to 3600, zones are 1 to 80")
    shutil.rmtree(given.out, ignore_errors=True)
    soak = usual._replace(hours=given.hours, pace=given.pace, zones=given.zones, seed=given.seed)
    try:
        result, observations = run(soak, given.out)
    except ReplayError as error:
        print(f"soak: {error}", file=sys.stderr)
        return 1
    verdicts = judge(observations, soak.pace)
    report = result | {"observations": [one._asdict() for one in observations]}
    (given.out / "soak.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    print("\n".join(lines(result, verdicts)))
    return 0 if all(one.within for one in verdicts) else 1


if __name__ == "__main__":
    raise SystemExit(main())
