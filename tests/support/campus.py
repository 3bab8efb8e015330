"""A campus for a fleet: rooms that read one recording, and one room that is posted to."""

import tomllib
from collections.abc import Sequence
from pathlib import Path

from support import sites

PERIOD = 600
POSTED = "posted"
"""The room that clients post to."""


def told_by_clients(zone: str, period: int) -> str:
    """The table of a zone whose readings are posted, sampled every `period` s."""
    channels = "\n".join(f'{name} = {{ source = "clients", unit = "{unit}" }}' for name, unit in sites.UNITS.items())
    own = f'[[zones]]\nid = "{zone}"\nperiod = {period}\nnetwork = "tite"\nestimator = "ekf"\n'
    return f"\n{own}[zones.channels]\n{channels}\n"


def posted(zone: str, period: int) -> sites.Table:
    """The same, parsed."""
    return tomllib.loads(told_by_clients(zone, period))["zones"][0]


def rooms(count: int) -> list[str]:
    """The rooms of the recording."""
    return [f"room-{number:04d}" for number in range(count)]


def write_recording(path: Path, count: int, rows: int) -> sites.Table:
    """Write `rows` samples of so many rooms, each now and then without a measurement."""
    return sites.recording(path, rooms(count), rows, PERIOD, (61, 3))


def write_site(
    folder: Path,
    database: str,
    *,
    site: str,
    count: int,
    shards: int,
    pace: float | str,
    lease: float,
    rows: int = 4,
    zenoh: sites.Table | None = None,
    sources: sites.Table | None = None,
    zones: Sequence[sites.Table] = (),
    checkpoint_every: float = 2.0,
) -> Path:
    """The configuration of a campus beside its recording of so many `rows`; with more `sources` and `zones`."""
    log = write_recording(folder / "recording.csv", count, rows) | {"pace": pace}
    own = [
        sites.recorded(
            room, period=PERIOD, **({"estimator": "ekf"} if k % 2 else {"estimator_options": {"particles": 50}})
        )
        for k, room in enumerate(rooms(count))
    ]
    return sites.written(
        folder,
        {"log": log, "clients": {"kind": "http"}, **(sources or {})},
        [*own, posted(POSTED, 3600), *zones],
        site={"id": site, "checkpoint_every": checkpoint_every},
        http={"port": 0},
        zenoh=zenoh or {"enabled": False},
        fleet={"database": database, "shards": shards, "shard_cpus": 1.0, "lease": lease},
    )


def small_site(folder: Path, count: int = 1, shards: int = 1, site: str = "campus", lease: float = 5.0) -> Path:
    """The same with a short recording, for a fleet that stands still."""
    return write_site(folder, "postgresql://db/x", site=site, count=count, shards=shards, pace=60.0, lease=lease)
