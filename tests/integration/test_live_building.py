"""The daemon reads the simulated building over Modbus: every zone learns, and a fault stays where it is."""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Iterator
from itertools import pairwise

import pytest
from support.bms_process import Bms, simulated
from support.harness import Daemon

from replay.bms.faults import MENU


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Bms, Daemon]]:
    """A building of three rooms at ten simulated minutes per second, and the daemon on its written configuration."""
    folder = tmp_path_factory.mktemp("plant")
    config = folder / "bms.toml"
    arguments = ("--zones", 3, "--zenoh", "off", "--pace", 600, "--write-config", config)
    settings: dict[str, object] = {f"zones.{k}.estimator_options.particles": 200 for k in range(3)}
    with simulated(*arguments) as bms, Daemon(config, folder / "log", settings) as daemon:
        yield bms, daemon


def switch_off(bms: Bms) -> None:
    urllib.request.urlopen(urllib.request.Request(f"{bms.control}/faults", method="DELETE"), timeout=180).close()


def ask(url: str) -> dict:
    with urllib.request.urlopen(url, timeout=180) as answer:
        return json.load(answer)


def test_every_room_is_read_and_forecast(plant: tuple[Bms, Daemon]) -> None:
    bms, daemon = plant
    daemon.wait(lambda zones: all(zone["samples"] >= 6 for zone in zones.values()))
    truth = ask(f"{bms.control}/state")["rooms"]
    for name, room in truth.items():
        rows = daemon.history(name)
        # A step of the history may be some simulated minutes older than the truth.
        assert rows[-1]["y"] == pytest.approx(room["T_air"], abs=1.5)
        status, forecast = daemon.get(f"/zones/{name}/forecast")
        assert status == 200, forecast


def test_a_device_that_drops_out_stalls_its_room_until_it_is_back(plant: tuple[Bms, Daemon]) -> None:
    bms, daemon = plant
    daemon.wait(lambda zones: all(zone["samples"] >= 6 for zone in zones.values()))
    bms.post("/faults", {"kind": "drop", "device": "room3"})
    daemon.wait(lambda zones: zones["room3"]["state"] == "stalled")
    switch_off(bms)
    daemon.wait(lambda zones: zones["room3"]["state"] == "running")


@pytest.mark.parametrize("kind", [kind for kind, entry in MENU.items() if entry.scope != "clock"])
def test_no_fault_of_a_room_harms_one_that_does_not_touch_it(kind: str, plant: tuple[Bms, Daemon]) -> None:
    bms, daemon = plant
    before = daemon.wait(lambda zones: zones["room1"]["samples"] >= 6)["room1"]["samples"]
    bms.post("/faults", {"kind": kind, "device": "room3"})
    rows: list[dict] = []

    def four_in_a_row(zones: dict) -> bool:
        # On a busy machine a poll may come after its sample.
        rows[:] = daemon.history("room1")[-4:]
        room = zones["room1"]
        return (
            room["samples"] >= before + 4 and room["state"] == "running" and all(row["y"] is not None for row in rows)
        )

    daemon.wait(four_in_a_row)
    switch_off(bms)
    assert [later["time"] > earlier["time"] for earlier, later in pairwise(rows)] == [True] * 3
    for row in rows:
        assert row["lower"] < row["mean"] < row["upper"]
