"""Two weeks of the demo's rooms as the daemon published them, the second one with windows that are opened.

`python tests/support/open_windows.py` writes `open_windows.csv.xz` anew, in a quarter of an hour. Its rooms are those
of the demo, which have learned for a fortnight before, and "living": its second room as Home Assistant has one, every
5 min, without set-point, sun and neighbours, which learns during the first week.
"""

import csv
import json
import lzma
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w

sys.path.insert(0, str(Path(__file__).parents[2]))

from adapters.fields.times import written_time
from estimator.arrays import Array
from replay.bms.living.calendar import FIRST_MIDNIGHT, Calendar
from replay.bms.living.world import STEP
from replay.bms.logged import BUILDING, FILE, LEARNED, ROOMS, SEED, _configuration, columns
from replay.bms.simulation import Simulation
from replay.localtime import DAY
from replay.recorded.learning import learn
from service.config.load import load
from service.recordings.history import survey

RECORD = Path(__file__).with_suffix(".csv.xz")
COLUMNS = ("zone", "time", "opening", "lower", "median", "upper")
"""UTC s; the widest opening of the period in W/K; unmeasured heat in W."""

WEEK = 7 * DAY


class Opening(NamedTuple):
    """A window of a room, open by `width` W/K from UTC s `begin` to `end`."""

    room: int
    begin: float
    end: float
    width: float


def openings(begin: float) -> Iterator[Opening]:
    """One or two a day and room in the second week after UTC s `begin`, which is at six in the morning: up to eight in
    the evening, 20 to 90 min long."""
    rng = np.random.default_rng(7)
    for day in range(7, 14):
        for room in range(ROOMS):
            for _ in range(1 + int(rng.random() < 0.4)):
                start = begin + day * DAY + rng.uniform(0, 14) * 3600
                yield Opening(room, start, start + rng.uniform(20, 90) * 60, rng.uniform(40, 160))


def live(folder: Path) -> tuple[dict[str, Any], Array]:
    """Let the building live two weeks, logged in `folder`: the demo's configuration, and what was open in each minute
    [UTC s] and room [W/K] (minutes, 1 + rooms)."""
    simulation, calendar = Simulation(zones=ROOMS, seed=SEED, pace=1.0, clock=lambda: 0.0), Calendar(ROOMS, SEED)
    world = simulation.world
    world.go_on(json.loads((folder / BUILDING).read_text(encoding="utf-8")))
    rooms, weather = columns(simulation)
    logged = [column for group in (weather, *rooms) for column in group.values()]
    opened, found = list(openings(world.now.time)), []
    with (folder / FILE).open("w", encoding="utf-8") as log:
        log.write(",".join(["time", *(column.name for column in logged)]) + "\n")
        for _ in range(2 * WEEK // 60):
            began = world.now.time
            log.write(",".join([written_time(began), *(f"{column.read():.3f}" for column in logged)]) + "\n")
            widths = np.zeros(ROOMS)
            for one in opened:
                widths[one.room] += one.width * (one.begin <= began < one.end)
            for _ in range(round(60 / STEP)):
                # People open windows for minutes; here they do not.
                world.step(widths - calendar.at(world.now.time + STEP - FIRST_MIDNIGHT).opening)
            found.append((began, *widths.tolist()))
    return _configuration(rooms, weather, simulation), np.array(found)


def as_at_home(raw: dict[str, Any]) -> dict[str, Any]:
    """The configuration `raw` with its second room alone, as Home Assistant has one."""
    zone = {name: value for name, value in raw["zones"][1].items() if name not in ("floor_area", "setpoint")}
    channels = {name: zone["channels"][name] for name in ("T_i", "T_out", "u_heat")}
    zone |= {"id": "living", "period": "5min", "network": "titeth", "channels": channels}
    return raw | {"site": raw["site"] | {"state_dir": "home"}, "zones": [zone]}


def main() -> None:
    """Write RECORD."""
    with tempfile.TemporaryDirectory() as name, lzma.open(RECORD, "wt", encoding="utf-8", newline="") as stream:
        folder, table = Path(name), csv.writer(stream)
        table.writerow(COLUMNS)
        with tarfile.open(LEARNED) as archive:
            archive.extractall(folder, filter="data")
        demo, opened = live(folder)
        for raw in (demo, as_at_home(demo)):
            raw["sources"]["logger"]["follow"] = False
            (folder / "rooms.toml").write_text(tomli_w.dumps(raw), encoding="utf-8")
            config = load(folder / "rooms.toml")
            for trace in learn(config, survey(config, config.zones), jobs=1).traces:
                room = 2 if trace.zone == "living" else int(trace.zone.removeprefix("room"))
                for row in trace.rows:
                    inside = (row.time <= opened[:, 0]) & (opened[:, 0] < row.time + trace.period)
                    gain = (row.gain_lower, row.gain_median, row.gain_upper)
                    table.writerow([trace.zone, row.time, *map(round, (opened[inside, room].max(), *gain))])


if __name__ == "__main__":
    main()
