"""A campus for a fleet: rooms that read one recording, and one room that is posted to."""

from __future__ import annotations

import math
from pathlib import Path

START = 1_746_230_400
PERIOD = 600
POSTED = "posted"
"""The room that clients post to."""


def told_by_clients(zone: str, period: int) -> str:
    """The table of a zone whose readings are posted, sampled every `period` s."""
    return f"""
[[zones]]
id = "{zone}"
period = {period}
network = "tite"
estimator = "ekf"
[zones.channels]
T_i    = {{ source = "clients", unit = "degC" }}
T_out  = {{ source = "clients", unit = "degC" }}
u_heat = {{ source = "clients", unit = "W" }}
"""


def rooms(count: int) -> list[str]:
    """The rooms of the recording."""
    return [f"room-{number:04d}" for number in range(count)]


def write_recording(path: Path, count: int, rows: int) -> None:
    """Write `rows` samples of so many rooms, each now and then without a measurement."""
    lines = ["time,T_out,heat," + ",".join(rooms(count))]
    for k in range(rows):
        outdoor, heat = 5 + 6 * math.sin(k / 22), 1500.0 * ((k // 5) % 3 == 0)
        indoor = [20 + math.sin(k / 9 + i) + 0.05 * math.sin(7.3 * k * (i + 1)) + heat / 4000 for i in range(count)]
        shown = [f"{value:.3f}" if (k + 97 * i) % 61 > 2 else "" for i, value in enumerate(indoor)]
        lines.append(f"{START + PERIOD * k},{outdoor:.3f},{heat:.0f},{','.join(shown)}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_site(
    folder: Path, database: str, *, site: str, count: int, shards: int, pace: float | str, lease: float, cpus: float
) -> Path:
    """The configuration of a campus beside its recording."""
    zones = "".join(
        f"""
[[zones]]
id = "{room}"
period = {PERIOD}
network = "tite"
estimator = "{"ekf" if number % 2 else "rbpf"}"
{"" if number % 2 else "estimator_options = { particles = 50 }"}
[zones.channels]
T_i    = {{ source = "log", column = "{room}", unit = "degC" }}
T_out  = {{ source = "log", column = "T_out", unit = "degC" }}
u_heat = {{ source = "log", column = "heat", unit = "W" }}
"""
        for number, room in enumerate(rooms(count))
    )
    path = folder / "site.toml"
    path.write_text(
        f"""
[site]
id = "{site}"
state_dir = "state"
checkpoint_every = 2

[http]
port = 0

[zenoh]
enabled = false

[fleet]
database = "{database}"
shards = {shards}
shard_cpus = {cpus}
lease = {lease}

[sources.log]
kind = "csv"
files = ["recording.csv"]
pace = {pace if isinstance(pace, float) else f'"{pace}"'}
timestamp = {{ column = "time", format = "epoch" }}

[sources.clients]
kind = "http"
{zones}
{told_by_clients(POSTED, 3600)}""",
        encoding="utf-8",
    )
    return path


def small_site(folder: Path, count: int = 1, shards: int = 1, site: str = "campus", lease: float = 5.0) -> Path:
    """The same with a short recording, for a fleet that stands still."""
    write_recording(folder / "recording.csv", count, 4)
    address = "postgresql://db/x"
    return write_site(folder, address, site=site, count=count, shards=shards, pace=60.0, lease=lease, cpus=1.0)
