"""One soak: a simulated building at speed, the daemon on it, and company, watched until the time is over."""

from __future__ import annotations

import asyncio
import json
import socket
import time
from pathlib import Path
from typing import Any, NamedTuple

import httpx

from replay.bms.background import living_bms
from replay.bms.serving import BmsOptions
from replay.lab.measuring.fleet.clients import Clients
from replay.lab.measuring.processes import DaemonProcess
from replay.lab.measuring.soak.company import Company
from replay.lab.measuring.soak.observation import Observation, observe
from replay.lab.measuring.soak.verdict import Verdict, judge, summary


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


def run(soak: Soak, folder: Path) -> tuple[dict[str, Any], list[Observation], list[Verdict]]:
    """Run `soak` in `folder`, which is empty or is made; figures, observations and verdicts.

    Raises MeasurementError where the daemon ends before its time or does not stop in order.
    """
    folder.mkdir(parents=True, exist_ok=True)
    config, zenoh_port, control_port = folder / "soak.toml", _free_port(), _free_port()
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
    with living_bms(options), DaemonProcess(config, folder / "daemon.log") as daemon:
        url, control = daemon.url(), f"http://127.0.0.1:{control_port}"
        zones = [zone["id"] for zone in httpx.get(f"{url}/zones").json()["zones"]]
        company = Company(url, control, zenoh_port, zones, soak.seed, soak.faults)
        with Clients(url, zones, soak.clients, pause=0.2) as clients:
            observations = asyncio.run(_watch(soak, daemon, folder / "state", url, company))
            answers = clients.finish()
        stopped = daemon.stop()
    found = summary(observations, soak.pace) | {
        "soak": soak._asdict(),
        "zones": len(zones),
        "stop_s": stopped,
        "company": {
            "opened": company.opened,
            "events": company.events,
            "heard": company.heard,
            "faults": company.faults,
            "reloads": company.reloads,
            "requests": len(answers),
            "not_answered": sum(answer.status == 0 for answer in answers),
            "failed": sum(answer.status in (500, 502) for answer in answers),
        },
    }
    return found, observations, judge(observations, soak.pace)


async def _watch(soak: Soak, daemon: DaemonProcess, state_dir: Path, url: str, company: Company) -> list[Observation]:
    """Observations every `every` s until the simulated time is over."""
    keeping = asyncio.create_task(company.keep(daemon.process.pid, soak.streams))
    observations: list[Observation] = []
    began = time.monotonic()
    async with httpx.AsyncClient(base_url=url, timeout=60.0) as client:
        while (elapsed := time.monotonic() - began) < soak.hours * 3600.0 / soak.pace:
            daemon.check()
            if keeping.done():
                keeping.result()
            metrics = (await client.get("/metrics")).raise_for_status().text
            observations.append(observe(daemon, state_dir, metrics, elapsed, company.streams))
            await asyncio.sleep(max(0.0, began + len(observations) * soak.every - time.monotonic()))
    keeping.cancel()
    await asyncio.gather(keeping, return_exceptions=True)
    return observations


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
