"""A site whose recording, seeds and clock never change: zones of several estimators that have learned from it."""

import asyncio
import json
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w
from support.running_zone import plumbing

from service.config.fitting import fingerprint, make_alignment, make_worker, surroundings
from service.config.load import load
from service.config.site import Config
from service.publish.metrics import Metrics
from service.recordings.merged import recorded
from service.zone.zone import Zone

SITE = "golden"
START = 1_767_225_600  # 2026-01-01T00:00:00Z
PERIOD = 600
SAMPLES = 170
ENDED = "ekf"
"""The zone whose recording has come to its end."""

HEATED = {"T_i": "west", "T_out": "outside", "u_heat": "heat"}
EAST = {"T_air": "east", "T_out": "outside", "T_adj": "west", "u_heat": "heat"}
WITH_WALL = {"T_i": "west", "T_e": "wall", "T_out": "outside", "u_heat": "heat"}
"""The column of each channel."""

TWO_SENSORS = json.loads(Path(__file__).with_name("two-sensors.json").read_text(encoding="utf-8"))
MEMBERS = {
    "jump": {"estimator": "mkf", "particles": 30, "scenarios": 30},
    "ekf": {"estimator": "ekf"},
    "arx": {"estimator": "arx"},
}
BLOCKS = {"air": ["T_i"], "mass": ["T_e", "T_h"]}


def tables() -> dict[str, Any]:
    """The configuration."""
    stamp = {"column": "time", "format": "iso8601", "zone": "UTC"}
    zones = [
        _zone("rbpf", 3, HEATED, levels=[0.95, 0.5], options={"particles": 80, "volatility_blocks": BLOCKS}),
        _zone("mkf", 4, EAST, "ecolar-6r4c", [0.9], {"particles": 40, "scenarios": 60}),
        _zone("bank", 5, HEATED, options={"members": MEMBERS}),
        _zone("ekf", 6, WITH_WALL, TWO_SENSORS),
        _zone("arx", 7, HEATED | {"T_i": "east"}),
        _zone("waiting", None, HEATED | {"T_i": "never"}, estimator="ekf"),
    ]
    zones[0] |= {"setpoint": {"source": "recording", "column": "wanted", "unit": "degC"}}
    zones[0]["channels"]["u_heat"]["installed"] = 3000
    return {
        "site": {"id": SITE, "state_dir": "state", "time_zone": "Europe/Berlin"},
        "sources": {"recording": {"kind": "csv", "files": ["recording.csv"], "timestamp": stamp}},
        "zones": zones,
    }


def _zone(
    id: str,
    seed: int | None,
    columns: Mapping[str, str],
    network: Any = "titeth",
    levels: Sequence[float] = (0.95,),
    options: Mapping[str, Any] | None = None,
    estimator: str = "",
) -> dict[str, Any]:
    units = {"u_heat": "kW"}
    channels = {
        name: {"source": "recording", "column": column, "unit": units.get(name, "degC")}
        for name, column in columns.items()
    }
    zone = {"id": id, "period": "10min", "network": network, "levels": list(levels), "estimator": estimator or id}
    zone |= {"seed": seed} if seed is not None else {}
    return zone | ({"estimator_options": options} if options else {}) | {"channels": channels}


def rows() -> Iterator[tuple[int, str]]:
    """The recording, without any function whose last digit depends on the machine: UTC s, and the cells of a row."""
    west, east, wall = 20_000, 17_000, 15_000
    for k in range(SAMPLES):
        outside = 3_000 - 150 * abs(k // 6 % 24 - 14)
        heat = 1_800 if k % 9 < 4 else 0
        noise = 17 * (k * 7919 % 11 - 5)
        disturbed = 900 if 70 <= k < 76 else 0
        cells = [west + noise + disturbed, east + noise, wall + noise // 2, outside, heat, 20_500]
        texts = [f"{cell / 1000:.3f}" for cell in cells]
        # A sensor that is away for an interval, one that is away for longer, and a value that nobody believes.
        if k == 40:
            texts[0] = ""
        if 50 <= k < 53:
            texts[3] = ""
        if k == 60:
            texts[1] = "8000"
        yield START + k * PERIOD, ",".join([*texts, "away"])
        west += (heat - (west - wall) // 3) // 25
        wall += ((west - wall) - (wall - outside) // 4) // 60
        east += ((west - east) // 4 + (outside - east) // 12 + heat // 3) // 20


class GoldenSite(NamedTuple):
    """The configuration, and the zones by id."""

    config: Config
    zones: dict[str, Zone]
    metrics: Metrics


def written(folder: Path) -> Path:
    """The configuration in `folder`, with its recording beside it."""
    times = [f"{_stamp(time)},{cells}" for time, cells in rows()]
    header = "time,west,east,wall,outside,heat,wanted,never"
    (folder / "recording.csv").write_text("\n".join([header, *times, ""]), encoding="utf-8")
    path = folder / "golden.toml"
    path.write_text(tomli_w.dumps(tables()), encoding="utf-8")
    return path


@asynccontextmanager
async def learned(folder: Path) -> AsyncIterator[GoldenSite]:
    """The site after its recording, as a daemon has it: journal, checkpoints and threads in `folder`."""
    config = load(written(folder))
    zones: dict[str, Zone] = {}
    metrics = Metrics(zones, "1.2.3")
    async with plumbing(folder / "state") as given:
        shared = given._replace(site=SITE, metrics=metrics, sinks=[metrics])
        around = surroundings(config)
        for table in config.zones:
            zone = Zone(table.id, table.estimator, fingerprint(table), make_worker(table), shared, around[table.id])
            await zone.prepare()
            zone.align(make_alignment(table))
            zones[table.id] = zone
            metrics.add(table.id)
        running = [asyncio.create_task(zone.run()) for zone in zones.values()]
        async for part in recorded(config, zones, None, None):
            zone = zones[part.zone]
            if part.now < inf:
                await zone.intake.deliver(part.source, part.readings, part.now)
            elif part.zone == ENDED:
                await zone.end(part.source)
        for zone in zones.values():
            await zone.settled()
            await _recorded(zone)
        yield GoldenSite(config, zones, metrics)
        for zone in zones.values():
            await zone.intake.close()
        await asyncio.gather(*running)


async def _recorded(zone: Zone) -> None:
    """Wait until the newest update of `zone` is announced and in its history."""
    async with asyncio.timeout(180):
        while zone.busy.waiting or zone.busy.finished == 0:
            assert zone.now().status.state != "failed", zone.now().status.reason
            await asyncio.sleep(0.01)
        while (update := zone.now().update) is not None:
            rows = await zone.history(None, None, 1)
            if rows and rows[0].time == update.time:
                return
            await asyncio.sleep(0.01)


def _stamp(time: int) -> str:
    hours, seconds = divmod(time - START, 3600)
    return f"2026-01-{1 + hours // 24:02}T{hours % 24:02}:{seconds // 60:02}:00Z"
