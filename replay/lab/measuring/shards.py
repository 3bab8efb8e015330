"""What it costs to run zones as a fleet: samples a second and processor time, beside the daemon on the same machine.

    python -m replay.lab.measuring.shards 'postgresql://thermogate@db.example/thermogate' --zones 60 --shards 1 2 4

The daemon and fleets of so many shards read the same recording as fast as they can, one after the other, each on all
processors of this machine. It is measured from the moment at which every zone has a sample until the last zone has come
to the end. The processor time is that of every process that was started for it, those of Ray included and that of the
database not. What they use once there is nothing left to do is told as well, in processors: on a machine that is busy
with other work a run takes longer, and more of that counts. Each run writes into a site of its own in that database,
which must not be there, and drops it afterwards.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import time
import tomllib
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import tomli_w

from estimator.errors import EstimatorError
from replay.errors import MeasurementError, ReplayError
from replay.lab.measuring.daemon import DaemonProcess, free_port
from replay.lab.measuring.scenario import Scenario, write
from service.errors import ServiceError
from service.store.postgres.database import Database
from service.store.postgres.names import schema_of

LOOK = 0.25
"""How often it is looked how far the zones are, s."""

IDLE_SECONDS = 15.0
"""How long it is measured what is used once all zones have come to the end."""

PATIENCE = 600.0
"""s without a new sample after which a run is given up."""

_ENDED = "come to an end"


def measure(database: str, scenario: Scenario, shards: Sequence[int], folder: Path) -> list[dict[str, Any]]:
    """The figures of the daemon and then of a fleet of each of `shards`. Raises ServiceError where a site is in the
    database already, and MeasurementError where a run does not come to its end."""
    for count in shards:
        _refuse_used(database, _site(count))
    runs = []
    for count in (0, *shards):
        site = _site(count)
        place = folder / site
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        port = free_port()
        config = _write_site(scenario, place, site, port, database, count)
        try:
            runs.append({"shards": count, **_run(config, place / "log", port, scenario, fleet=count > 0)})
        finally:
            if count:
                _drop(database, site)
    return [one | _against(one, runs[0]) for one in runs]


def _site(shards: int) -> str:
    return f"measured-{shards}"


def _run(config: Path, log: Path, port: int, scenario: Scenario, fleet: bool) -> dict[str, float]:
    """One run from start to stop."""
    command = ("fleet", "run") if fleet else ("run",)
    with DaemonProcess(config, log, command=command) as process:
        began = used = 0.0
        first, last, since = -1, 0, time.monotonic()
        while True:
            process.check()
            zones = _zones(f"http://127.0.0.1:{port}")
            now, count = time.monotonic(), sum(zone["samples"] for zone in zones)
            if count > last:
                last, since = count, now
            if first < 0 and len(zones) == scenario.zones and all(zone["samples"] for zone in zones):
                began, first, used = now, count, process.tree_cpu_seconds()
            if first >= 0 and all(_ENDED in zone["reason"] for zone in zones):
                break
            if now - since > PATIENCE:
                raise MeasurementError(f"no zone has had a sample for {PATIENCE:.0f} s; see {log}")
            time.sleep(LOOK)
        used = process.tree_cpu_seconds() - used
        memory = process.tree_resident_bytes()
        idle = process.tree_cpu_seconds()
        time.sleep(IDLE_SECONDS)
        idle = process.tree_cpu_seconds() - idle
        process.stop()
    samples = last - first
    if samples < scenario.zones:
        raise MeasurementError(f"only {samples} samples were left to measure; give more --rows")
    return {
        "samples": samples,
        "seconds": now - began,
        "samples_per_second": samples / (now - began),
        "cpu_seconds_per_1000_samples": 1000 * used / samples,
        "idle_processors": idle / IDLE_SECONDS,
        "resident_bytes": memory,
    }


def _against(run: dict[str, Any], daemon: dict[str, Any]) -> dict[str, float]:
    """How much less than the daemon a run did in a second, and how much more processor time it took; in per cent."""
    return {
        "slower_percent": 100 * (1 - run["samples_per_second"] / daemon["samples_per_second"]),
        "more_cpu_percent": 100 * (run["cpu_seconds_per_1000_samples"] / daemon["cpu_seconds_per_1000_samples"] - 1),
    }


def _write_site(scenario: Scenario, folder: Path, site: str, port: int, database: str, shards: int) -> Path:
    """The configuration of a run beside its recording; the daemon passes [fleet] over."""
    path = write(scenario, folder)
    document = tomllib.loads(path.read_text(encoding="utf-8"))
    document["site"]["id"] = site
    document["http"]["port"] = port
    # The estimators of all shards have as many threads as those of the daemon, one each at least.
    cpus = (os.cpu_count() or 1) / max(1, shards)
    document["fleet"] = {"database": database, "shards": max(1, shards), "shard_cpus": cpus}
    path.write_text(tomli_w.dumps(document), encoding="utf-8")
    return path


def _zones(url: str) -> list[dict[str, Any]]:
    """The zones as REST lists them; none before it serves."""
    try:
        answer = httpx.get(f"{url}/zones", timeout=30.0)
    except httpx.TransportError:
        return []
    found: list[dict[str, Any]] = answer.raise_for_status().json()["zones"]
    return found


def _refuse_used(database: str, site: str) -> None:
    with closing(Database(database, site)) as tables:
        if tables.read("SELECT to_regnamespace(%s) IS NOT NULL", schema_of(site))[0][0]:
            raise ServiceError(
                f"the schema {schema_of(site)} is there already; drop it with CASCADE, or use another database"
            )


def _drop(database: str, site: str) -> None:
    with closing(Database(database, site)) as tables:
        tables.transaction(lambda cursor: cursor.execute(f'DROP SCHEMA IF EXISTS "{schema_of(site)}" CASCADE'))


def table(runs: Sequence[dict[str, Any]]) -> str:
    """The figures for a person."""
    lines = ["               samples/s    CPU s per 1,000 samples     idle CPU     memory"]
    for run in runs:
        name = f"{run['shards']} shards" if run["shards"] else "daemon"
        lines.append(
            f"{name:<10} {run['samples_per_second']:>10.1f} ({-run['slower_percent']:+5.1f} %) "
            f"{run['cpu_seconds_per_1000_samples']:>12.2f} ({run['more_cpu_percent']:+5.1f} %) "
            f"{run['idle_processors']:>10.3f} {run['resident_bytes'] / 1e6:>8.0f} MB"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; 0 if that worked."""
    parser = argparse.ArgumentParser(prog="python -m replay.lab.measuring.shards", description=__doc__)
    parser.add_argument("database", help='such as "postgresql://thermogate@db.example/thermogate"')
    parser.add_argument("--zones", type=int, default=60)
    parser.add_argument("--particles", type=int, default=9000, help="per zone (default 9000)")
    parser.add_argument("--network", default="building-67", help="preset of every zone (default building-67)")
    parser.add_argument("--rows", type=int, default=60, help="samples of each zone (default 60)")
    parser.add_argument("--shards", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--out", type=Path, default=Path("var/shards"), help="folder (default var/shards)")
    given = parser.parse_args(arguments)
    if min(given.zones, given.rows, *given.shards) < 1:
        parser.error("zones, rows and shards are at least 1")
    scenario = Scenario(given.zones, given.particles, given.network, every=None, rounds=given.rows)
    try:
        runs = measure(given.database, scenario, given.shards, given.out)
    except (ReplayError, ServiceError, EstimatorError) as error:
        print(f"shards: {error}", file=sys.stderr)
        return 1
    (given.out / "shards.json").write_text(json.dumps(runs, indent=2) + "\n", encoding="utf-8")
    print(table(runs))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
