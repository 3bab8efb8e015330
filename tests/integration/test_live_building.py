"""The daemon reads the simulated building over Modbus: every zone learns, and a fault stays where it is."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.bms_process import Bms
from support.harness import Daemon

from replay.bms.faults import MENU

KINDS = [kind for kind, entry in MENU.items() if entry.scope != "clock"]


def test_every_room_is_forecast_and_no_fault_harms_another_room(tmp_path: Path) -> None:
    """A room for each kind of fault and one without, at ten simulated minutes per second."""
    config, count = tmp_path / "bms.toml", len(KINDS) + 1
    arguments = ("--zones", count, "--zenoh", "off", "--pace", 600, "--write-config", config)
    settings: dict[str, object] = {f"zones.{k}.estimator_options.particles": 50 for k in range(count)}
    with Bms(*arguments) as bms, Daemon(config, tmp_path / "log", settings) as daemon:
        daemon.wait(lambda zones: all(zone["samples"] >= 6 for zone in zones.values()))
        for name, room in bms.get("/state")["rooms"].items():
            # A step of the history may be some simulated minutes older than the truth.
            assert daemon.history(name)[-1]["y"] == pytest.approx(room["T_air"], abs=1.5)
            status, forecast = daemon.get(f"/zones/{name}/forecast")
            assert status == 200, forecast
        before = daemon.status("room1")["samples"]
        broken = {kind: f"room{2 + number}" for number, kind in enumerate(KINDS)}
        for kind, device in broken.items():
            bms.break_down(kind, device)
        daemon.wait(lambda zones: zones[broken["drop"]]["state"] == "stalled")
        rows: list[dict] = []

        def four_in_a_row(zones: dict) -> bool:
            # On a busy machine a poll may come after its sample.
            rows[:] = daemon.history("room1")[-4:]
            room = zones["room1"]
            measured = all(row["y"] is not None for row in rows)
            return room["samples"] >= before + 4 and room["state"] == "running" and measured

        daemon.wait(four_in_a_row)
        assert all(row["lower"] < row["mean"] < row["upper"] for row in rows)
        bms.mend()
        daemon.wait(lambda zones: zones[broken["drop"]]["state"] == "running")
