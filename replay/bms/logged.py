"""The living building as a logger writes it down, in its own time: the plant of the demo. It has lived for a fortnight
when the daemon comes, which has learned what came of it; then it goes on at its pace, and the daemon follows the file.
On a slow machine both are slower, and no number is another."""

import asyncio
import json
import tarfile
from collections.abc import Callable
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from adapters.fields.times import written_time
from replay.bms.control import create_control
from replay.bms.living.calendar import ZONE
from replay.bms.living.thermostats import Relay
from replay.bms.simulation import Simulation
from replay.localtime import DAY
from replay.simulated.weather import KONSTANZ
from service.config.overrides import apply_overrides
from service.config.site import HttpConfig
from service.web.server.server import HttpServer

ROOMS, SEED = 4, 1
LIVED_DAYS = 14
LEARNED = Path(__file__).with_name("learned.tar.xz")
"""The building and the state of a daemon after these days; `make demo-state` writes it anew."""
_ROW = 60.0
"""Simulated seconds between two rows."""
LIVED_ROWS = round(LIVED_DAYS * DAY / _ROW)
_FLOOR_AREA = 40.0
"""m2 of a room; the building's parameters are those of such rooms."""
FILE, STATE, BUILDING, _CONFIGURATION = "building-SYNTHETIC.csv", "state", "building.json", "demo.toml"
"""In the folder of a demo."""


class Demo(NamedTuple):
    """A building that lives `pace` simulated seconds in a second, logged in `directory`."""

    directory: Path
    pace: float
    overrides: tuple[str, ...] = ()
    knows: bool = True
    """Whether its rooms begin with what the usual ones have learned, where they have no state."""


class Column(NamedTuple):
    """A column of the log: the channel of a zone that it is, its unit, the factor to that, and its value now."""

    name: str
    unit: str
    scale: float
    read: Callable[[], float]


async def live(demo: Demo, stop: asyncio.Event, ready: Callable[[tuple[Path, str]], None]) -> None:
    """Live until `stop`; `ready` is called with the configuration and the URL of the control surface."""
    elapsed = 0.0
    # The simulation counts real seconds; here they pass as the rows do.
    simulation = Simulation(zones=ROOMS, seed=SEED, pace=demo.pace, clock=lambda: elapsed / demo.pace)
    rooms, weather = columns(simulation)
    demo.directory.mkdir(parents=True, exist_ok=True)
    if demo.knows and not (state := demo.directory / STATE).exists():
        state.mkdir(0o700)
        with tarfile.open(LEARNED) as archive:
            archive.extractall(demo.directory, filter="data")
    if (building := demo.directory / BUILDING).exists():
        simulation.world.go_on(json.loads(building.read_text(encoding="utf-8")))
        elapsed = simulation.world.elapsed
    configuration = demo.directory / _CONFIGURATION
    raw = apply_overrides(_configuration(rooms, weather, simulation), demo.overrides)
    configuration.write_text(_HEAD + tomli_w.dumps(raw), encoding="utf-8")
    http = HttpServer(create_control(simulation), HttpConfig(port=0), "the control surface")
    loop, every = asyncio.get_running_loop(), [column for group in (weather, *rooms) for column in group.values()]
    # A folder that is kept goes on where it was: the same seed lives the same days again, at once.
    lived = max(LIVED_DAYS * DAY, elapsed + _rows(demo.directory / FILE) * _ROW)
    with (demo.directory / FILE).open("w", encoding="utf-8") as log:
        log.write(",".join(["time", *(column.name for column in every)]) + "\n")
        # The configuration is checked against it as soon as it is `ready`.
        log.flush()
        serving = asyncio.create_task(http.run())
        try:
            await http.started(serving)
            ready((configuration, http.url))
            due = loop.time()
            while not stop.is_set():
                values = (column.read() for column in every)
                cells = (f"{value:.3f}" if isfinite(value) else "" for value in values)
                log.write(",".join([written_time(simulation.world.now.time), *cells]) + "\n")
                elapsed += _ROW
                simulation.catch_up()
                due = max(due + (_ROW / demo.pace if elapsed > lived else 0.0), loop.time())
                if elapsed > lived or elapsed % DAY == 0:
                    log.flush()
                await asyncio.sleep(due - loop.time())
            await http.stop(serving)
        finally:
            serving.cancel()
            await asyncio.gather(serving, return_exceptions=True)
            http.close()


def columns(simulation: Simulation) -> tuple[list[dict[str, Column]], dict[str, Column]]:
    """What is logged of every room, and of the weather, by the channel of a zone."""
    rooms: list[dict[str, Column]] = []
    weather: dict[str, Column] = {}
    for device in simulation.plant:
        found = {
            "T_i" if channel.zone_channel == "T_air" else channel.zone_channel: Column(
                f"{device.name}_{channel.name}",
                "W" if channel.factor != 1.0 else channel.unit,
                channel.factor,
                partial(simulation.value, device, channel),
            )
            for channel in device.channels
            if channel.zone_channel is not None
        }
        if device.room is None:
            weather |= found
        else:
            wanted = partial(_set_point, simulation, device.room)
            rooms.append(found | {"setpoint": Column(f"{device.name}_setpoint", "degC", 1.0, wanted)})
    return rooms, weather


def _configuration(
    rooms: list[dict[str, Column]], weather: dict[str, Column], simulation: Simulation
) -> dict[str, Any]:
    return {
        "site": {
            "id": "demo",
            "state_dir": STATE,
            "time_zone": ZONE,
            "latitude": KONSTANZ.latitude,
            "longitude": KONSTANZ.longitude,
        },
        "http": {"host": "127.0.0.1", "port": 8080},
        "zenoh": {"listen": ["tcp/127.0.0.1:7447"]},
        "sources": {"logger": {"kind": "csv", "files": [FILE], "timestamp": {"column": "time"}, "follow": True}},
        "zones": [_zone(simulation, index, rooms, weather) for index in range(len(rooms))],
    }


def _zone(
    simulation: Simulation, index: int, rooms: list[dict[str, Column]], weather: dict[str, Column]
) -> dict[str, Any]:
    building = simulation.building
    read = weather | rooms[index]
    set_point = read.pop("setpoint")
    read |= {f"T_adj_{building.rooms[other].name}": rooms[other]["T_i"] for other in building.neighbours(index)}
    channels = {name: _channel(column) for name, column in read.items()}
    if isinstance(building.rooms[index].thermostat, Relay):
        # A relay answers to the room within a period: with the mean over it, heating seems to do less.
        channels["T_i"]["aggregate"] = "first"
    return {
        "id": building.rooms[index].name,
        "period": "15min",
        "network": "auto",
        "floor_area": _FLOOR_AREA,
        "channels": channels,
        "setpoint": _channel(set_point),
    }


def _channel(column: Column) -> dict[str, Any]:
    table: dict[str, Any] = {"source": "logger", "column": column.name, "unit": column.unit, "aggregate": "mean"}
    return table | ({"scale": column.scale} if column.scale != 1.0 else {})


def _rows(log: Path) -> int:
    """Of an earlier log; 0 if there is none."""
    return max(log.read_bytes().count(b"\n") - 1, 0) if log.exists() else 0


def _set_point(simulation: Simulation, room: int) -> float:
    return float(simulation.world.now.set_point[room])


_HEAD = """\
# Written by `thermogate demo`: a SYNTHETIC building; nobody lives behind these numbers.
# Its logger writes a row for every minute of the building's own time, and the daemon follows the file.

"""
