"""Measured rooms, whose CSV files belong to others: `rooms.toml` and docs/benchmark.md say where and what they are."""

import csv
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime, timedelta, timezone
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.heat.sun import Location
from estimator.network import presets
from replay.errors import ReplayError
from replay.experiments.hours_ahead.recordings import Recording
from replay.experiments.series.recorded_zone import ZoneRecord, bridged, held
from replay.localtime import HOUR
from service.config.known_heat import usually_heated
from service.config.site import Whereabouts
from service.records.outlook import SET_POINTS

_HELD = 2 * HOUR
"""How long a missing input keeps its last value [s]."""
BRIDGED = 12
"""`max_gap` of a zone that does not set it."""
_TITETHRIA = presets.network("titethria")
_NETWORKS = {
    "with sun": _TITETHRIA.with_solar("T_i", presets.SOLAR_APERTURE).validate(),
    "without sun": _TITETHRIA.validate(),
}


class Room(NamedTuple):
    file: str
    what: str
    period: int
    channels: Mapping[str, tuple[str, float]]
    row: str | None = None
    location: tuple[float, float] | None = None
    time_zone: str | None = None
    ahead_of_utc: int = 0
    """h: of times without a zone."""
    network: str | None = None
    dated: bool = True
    last: int | None = None


def _read() -> Iterator[tuple[str, Room]]:
    entries = tomllib.loads(files(__package__).joinpath("rooms.toml").read_text(encoding="utf-8"))["files"]
    for entry in entries:
        name, channels = entry.pop("name"), entry.pop("channels")
        for room in entry.pop("rooms", [name]):
            texts: dict[str, Any] = {
                key: value.format(room) if isinstance(value, str) else value for key, value in entry.items()
            }
            named = {channel: (column.format(room), factor) for channel, (column, factor) in channels.items()}
            yield name.format(room), Room(channels=named, **texts)


ROOMS: Mapping[str, Room] = dict(_read())
FILES = tuple(dict.fromkeys(room.file for room in ROOMS.values()))


def check_folder(folder: Path | None, files: Sequence[str]) -> None:
    """ReplayError where a `folder` was given that holds none of `files`."""
    if folder is not None and not any((folder / path).exists() for path in files):
        raise ReplayError(f"--data {folder}: it holds none of {', '.join(files)}")


def read_room(name: str, folder: Path | None) -> Recording | None:
    """The recording of that name below `folder`, with its network; None where its file is not
    there, ReplayError where it is not what it should be."""
    room = ROOMS[name]
    path = folder and folder / room.file
    if path is None or not path.exists():
        return None
    times, columns = _columns(path, room)
    where = Whereabouts(room.location and Location(*room.location), room.time_zone)
    if room.network is None:
        network, what = (
            usually_heated(presets.automatic(room.channels), where.location),
            f"{room.what}; the network auto",
        )
    else:
        network, what = _NETWORKS[room.network], room.what
    series = bridged(ZoneRecord(times, room.period, columns), network, BRIDGED)
    return Recording(name, what, True, network, room.period, series, whereabouts=where)


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """ReplayError in place of what reading the file at `path` raises."""
    try:
        yield
    except OSError as error:
        raise ReplayError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error
    except (KeyError, ValueError, TypeError) as error:
        raise ReplayError(f"{path}: {error} is not what docs/benchmark.md says of its columns; look there") from error


def _columns(path: Path, room: Room) -> tuple[np.ndarray, dict[str, Array]]:
    """UTC s (K,) and channels (K,), inputs held."""
    zone = timezone(timedelta(hours=room.ahead_of_utc))
    with _explained(path), path.open(encoding="utf-8-sig", newline="") as file:
        rows = [row for row in csv.DictReader(file) if room.row in (None, row.get("room"))][: room.last]
        times = room.period * np.arange(len(rows), dtype=np.int64)
        if room.dated:
            times = np.array([round(_dated(row["time"], zone).timestamp()) for row in rows], dtype=np.int64)
        table = {
            channel: factor * np.array([float(row[column] or "nan") for row in rows]) if column else np.zeros(len(rows))
            for channel, (column, factor) in room.channels.items()
            if channel != SET_POINTS or any(column in row for row in rows)
        }
    if not rows:
        raise ReplayError(f"{path}: it has no rows of the room; look at docs/benchmark.md")
    if not room.dated and not all(np.isfinite(values).all() for values in table.values()):
        raise ReplayError(f"{path}: it has gaps; this is not the published file")
    inputs = {channel: held(times, values, _HELD) for channel, values in table.items() if channel != "T_i"}
    return times, {"T_i": table["T_i"], **inputs}


def _dated(text: str, zone: timezone) -> datetime:
    """A time, in `zone` where it names none."""
    found = datetime.fromisoformat(text)
    return found if found.tzinfo is not None else found.replace(tzinfo=zone)
