"""Measured rooms that anybody can have, as CSV files: read where they lie, for they belong to others.

docs/benchmark.md says where each is had, under which licence, and what its columns are.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.heat.sun import Location
from estimator.network import presets
from estimator.network.network import Network
from replay.errors import ReplayError
from replay.experiments.hours_ahead.recordings import Recording
from replay.experiments.series.recorded_zone import ZoneRecord, bridged
from replay.localtime import HOUR
from service.config.known_heat import usually_heated
from service.config.site import Whereabouts

_HELD = 2 * HOUR
"""How long a missing input keeps its last value [s]."""
BRIDGED = 12
"""`max_gap` of a zone that does not set it."""


class Room(NamedTuple):
    """One room of a file: by channel the column and what it is multiplied with; "" is a channel that nobody measured,
    and is 0 throughout. `room` chooses the rows of a file that has several rooms, by its column `room`."""

    file: str
    what: str
    period: int
    channels: Mapping[str, tuple[str, float]]
    room: str | None = None
    whereabouts: Whereabouts = Whereabouts()
    ahead_of_utc: int = 0
    """h: of times without a zone."""
    network: Network | None = None
    """None: `auto` of the channels."""
    dated: bool = True
    """Whether rows have a `time`; if not, they follow each other without a gap."""
    rows: slice = slice(None)


def _twin_house(room: str) -> Room:
    neighbours = {f"T_adj_{other}": (f"T_{other}", 1.0) for other in ("corridor", "attic", "cellar")}
    return Room(
        "rooms/twinhouse_n2.csv",
        f"the room '{room}' of the Fraunhofer twin house N2, where nobody lives, under a pseudo-random heating",
        600,
        {"T_i": (f"T_{room}", 1.0), "T_out": ("T_out", 1.0), "u_heat": (f"P_{room}", 1.0), "I_sol": ("GHI", 1.0)}
        | neighbours,
        whereabouts=Whereabouts(Location(47.87, 11.73), "Europe/Berlin"),
        # By the clock of winter, as its irradiance shows.
        ahead_of_utc=1,
    )


def _flat(room: str) -> Room:
    return Room(
        "rooms/opensmarthome.csv",
        f"the room '{room}' of a flat that people live in, without power and sun",
        900,
        {"T_i": ("T_room", 1.0), "T_out": ("T_out", 1.0), "u_heat": ("", 0.0)},
        room,
        Whereabouts(time_zone="Europe/Berlin"),
    )


def _university(room: str) -> Room:
    return Room(
        "rooms/ou44.csv",
        f"the room '{room}' of the university building OU44; the heating is the opening of its valve times 1 kW",
        600,
        {"T_i": ("T_room", 1.0), "T_out": ("T_out", 1.0), "u_heat": ("valve_pct", 10.0), "I_sol": ("GHI", 1.0)},
        room,
        Whereabouts(Location(55.4, 10.4), "Europe/Copenhagen"),
    )


_BY_SUN = presets.titethria().with_solar("T_i", presets.SOLAR_APERTURE).validate()
ROOMS: Mapping[str, Room] = {
    "FlexHouse": Room(
        "flexhouse_prbs1/inputPRBS1.csv",
        "a light-weight office at Risø heated by a binary sequence; TiTeThRia with a free solar aperture",
        300,
        {"T_i": ("yTi", 1.0), "T_out": ("Ta", 1.0), "u_heat": ("Ph", 1000.0), "I_sol": ("Ps", 1000.0)},
        network=_BY_SUN,
        dated=False,
    ),
    "darkgreybox demo": Room(
        "darkgreybox_demo/demo_data.csv",
        "a large building without a measurement of the sun; TiTeThRia with the bounds of the preset",
        HOUR,
        {"T_i": ("Ti", 1.0), "T_out": ("Ta", 1.0), "u_heat": ("Ph", 1000.0)},
        network=presets.titethria().validate(),
        dated=False,
    ),
    "armadillo": Room(
        "armadillo/armadillo_data_H2.csv",
        "a small test house; TiTeThRia with a free solar aperture",
        1800,
        {"T_i": ("T_int", 1.0), "T_out": ("T_ext", 1.0), "u_heat": ("P_hea", 1.0), "I_sol": ("I_sol", 1.0)},
        network=_BY_SUN,
        dated=False,
        # The last row is dropped, as in what its authors published.
        rows=slice(-1),
    ),
    **{
        f"twin house {room}": _twin_house(room) for room in ("living", "bath", "child", "kitchen", "doorway", "bedroom")
    },
    **{f"flat {room}": _flat(room) for room in ("Bathroom", "Kitchen", "Room1", "Room2", "Room3", "Toilet")},
    **{f"OU44 {room}": _university(room) for room in ("22-508-1", "22-511-2")},
    "housetemp": Room(
        "rooms/housetemp.csv",
        "a house with a heat pump, whose thermometer has steps of 0.56 K; the heating is the share of time in which "
        "the pump ran times 5 kW",
        600,
        {"T_i": ("T_room", 1.0), "T_out": ("T_out", 1.0), "u_heat": ("heating", 5000.0)},
    ),
}
"""By the name of the recording."""

FILES = tuple(dict.fromkeys(room.file for room in ROOMS.values()))


def read_room(name: str, folder: Path | None) -> Recording | None:
    """The recording of that name below `folder`, with its network; None where its file is not
    there, ReplayError where it is not what it should be."""
    room = ROOMS[name]
    path = folder and folder / room.file
    if path is None or not path.exists():
        return None
    times, columns = _columns(path, room)
    network = room.network or usually_heated(presets.automatic(room.channels), room.whereabouts.location)
    series = bridged(ZoneRecord(times, room.period, columns), network, BRIDGED)
    what = room.what if room.network else f"{room.what}; the network auto"
    return Recording(name, what, True, network, room.period, series, whereabouts=room.whereabouts)


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
        rows = [row for row in csv.DictReader(file) if room.room is None or row["room"] == room.room][room.rows]
        times = room.period * np.arange(len(rows), dtype=np.int64)
        if room.dated:
            times = np.array([round(_dated(row["time"], zone).timestamp()) for row in rows], dtype=np.int64)
        table = {
            channel: factor * np.array([float(row[column] or "nan") for row in rows]) if column else np.zeros(len(rows))
            for channel, (column, factor) in room.channels.items()
        }
    if not rows:
        raise ReplayError(f"{path}: it has no rows of the room; look at docs/benchmark.md")
    if not room.dated and not all(np.isfinite(values).all() for values in table.values()):
        raise ReplayError(f"{path}: it has gaps; this is not the published file")
    inputs = {channel: _held(times, values) for channel, values in table.items() if channel != "T_i"}
    return times, {"T_i": table["T_i"], **inputs}


def _dated(text: str, zone: timezone) -> datetime:
    """A time, in `zone` where it names none."""
    found = datetime.fromisoformat(text)
    return found if found.tzinfo is not None else found.replace(tzinfo=zone)


def _held(times: np.ndarray, values: Array) -> Array:
    """`values` (K,) with the last one in place of a missing one, for as long as _HELD."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    return np.where(times - times[last] <= _HELD, values[last], np.nan)
