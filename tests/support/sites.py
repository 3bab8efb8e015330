"""Configurations for daemons of tests: zones of the network `tite`, what they read, and a recording of rooms."""

import csv
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import tomli_w
from support.harness import Daemon, overrides, thermogate

UNITS = {"T_i": "degC", "T_out": "degC", "u_heat": "W"}
START = 1_746_230_400
"""UTC s of the first row of a recording."""

Table = dict[str, Any]


def zone(id: str, source: str, places: Mapping[str, Mapping[str, Any]], **keys: Any) -> Table:
    """A zone with samples of a second and few particles; `places` are the further keys of each of its channels."""
    quick: Table = {"period": "1s", "network": "tite"}
    if "estimator" not in keys:
        quick["estimator_options"] = {"particles": 50}
    channels = {name: {"source": source, "unit": UNITS[name], **places.get(name, {})} for name in UNITS}
    return {"id": id, **quick, "channels": channels, **keys}


def written(folder: Path, sources: Mapping[str, Table], zones: Sequence[Table], **tables: Table) -> Path:
    """The configuration of a site "plant", whose state is beside it; `tables` are added to or changed."""
    site = {"id": "plant", "state_dir": str(folder / "state")} | tables.pop("site", {})
    path = folder / "plant.toml"
    path.write_text(tomli_w.dumps({"site": site, **tables, "sources": sources, "zones": zones}), encoding="utf-8")
    return path


def recording(path: Path, rooms: Sequence[str], rows: int, period: int, gaps: tuple[int, int]) -> Table:
    """A source with `rows` samples of `rooms`, written to `path`; of `gaps[0]` rows, a room has `gaps[1]` without a
    measurement."""
    lines = ["time,T_out,heat," + ",".join(rooms)]
    for k in range(rows):
        tens = k * period // 600
        outdoor, heat = 5 + 6 * math.sin(tens / 22), 1500.0 * ((tens // 5) % 3 == 0)
        shown = []
        for i in range(len(rooms)):
            indoor = 20 + math.sin(tens / 9 + i) + 0.05 * math.sin(7.3 * k * (i + 1)) + heat / 4000
            shown.append(f"{indoor:.3f}" if (k + 97 * i) % gaps[0] >= gaps[1] else "")
        lines.append(f"{START + period * k},{outdoor:.3f},{heat:.0f},{','.join(shown)}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return {"kind": "csv", "files": [path.name], "timestamp": {"column": "time", "format": "epoch"}}


def recorded(room: str, source: str = "log", **keys: Any) -> Table:
    """The zone of a `room` in such a recording."""
    columns = {"T_i": room, "T_out": "T_out", "u_heat": "heat"}
    return zone(room, source, {name: {"column": column} for name, column in columns.items()}, **keys)


def simulation(state: Path, pace: object = 36000, particles: int = 200) -> dict[str, object]:
    """Settings of the example building-67: about 60 samples a second, slow enough to be caught in the middle, and
    several checkpoints a second."""
    return {
        "site.state_dir": str(state),
        "site.checkpoint_every": 0.3,
        "zones.0.estimator_options.particles": particles,
        "sources.simulation.pace": pace,
    }


def replayed(config: Path, out: Path, settings: Mapping[str, object] | None = None) -> dict[str, list[Table]]:
    """What `thermogate replay` writes of every zone, in `out`, its cells as REST shows them."""
    done = thermogate("replay", config, "--out", out, *overrides(dict(settings or {})))
    assert done.returncode == 0, done.stderr
    found = {}
    for file in out.glob("*/updates.csv"):
        with file.open(encoding="utf-8") as stream:
            rows = csv.DictReader(stream)
            found[file.parent.name] = [{name: _shown(cell) for name, cell in row.items()} for row in rows]
    return found


def _shown(cell: str) -> object:
    with suppress(ValueError):
        return float(cell)
    return cell or None


def same_history(daemon: Daemon, zone: str, rows: Sequence[Table]) -> None:
    """Hold the history of a zone to the rows of a replay, bit for bit."""
    history = daemon.history(zone)
    assert [entry["time"] for entry in history] == [row["time"] for row in rows]
    for entry, row in zip(history, rows, strict=True):
        shared = row.keys() & entry.keys()
        assert {name: entry[name] for name in shared} == {name: row[name] for name in shared}
