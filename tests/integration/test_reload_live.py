"""A reload while a device is read live: one connection throughout, and every sample of the zone that stays."""

from __future__ import annotations

import tomllib
from datetime import datetime
from pathlib import Path

import tomli_w
from support.harness import Daemon, reload
from support.live_modbus import WORDS, configuration, running
from support.modbus_plant import plant


def test_the_connection_is_kept_and_no_sample_is_lost(tmp_path: Path) -> None:
    with running(plant(holding=[*WORDS, 190, 60])) as site:
        path = configuration(tmp_path, {"bms": site.port})
        table = tomllib.loads(path.read_text())
        (kept,) = table["zones"]
        added = kept | {"id": "added", "channels": {name: dict(where) for name, where in kept["channels"].items()}}
        added["channels"]["T_i"]["register"] = 4
        with Daemon(path, tmp_path / "log") as daemon:
            daemon.until("zone-bms", lambda status: status["samples"] >= 3)
            path.write_text(tomli_w.dumps(table | {"zones": [kept, added]}))
            reload(daemon, "configuration reloaded: added added")
            daemon.until("added", lambda status: status["samples"] >= 3)
            path.write_text(tomli_w.dumps(table))
            reload(daemon, "configuration reloaded: removed added")
            samples = daemon.until("zone-bms", lambda status: status["state"] == "running")["samples"]
            daemon.until("zone-bms", lambda status: status["samples"] >= samples + 3)
            assert site.connections == 1
            rows = daemon.history("zone-bms")
            times = [datetime.fromisoformat(row["time"]).timestamp() for row in rows]
            assert times == [times[0] + step for step in range(len(times))]
            # The very first interval may have begun before its first reading.
            assert all(row["y"] is not None for row in rows[1:])
            assert daemon.get("/zones/added")[0] == 404
            # A changed source is opened anew, and its zones go on.
            table["sources"]["bms"]["poll"] = 0.3
            path.write_text(tomli_w.dumps(table))
            reload(daemon, "configuration reloaded: sources changed: bms")
            samples = daemon.until("zone-bms", lambda status: status["state"] == "running")["samples"]
            daemon.until("zone-bms", lambda status: status["samples"] >= samples + 3)
            assert site.connections == 2
            assert "goes on after" not in daemon.log()
            assert daemon.terminate() == 0
