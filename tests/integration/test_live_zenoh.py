"""The daemon on live Zenoh: the example learns the simulated building, faults stay where they are, a probe."""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from support.bms_process import Bms, simulated
from support.harness import EXAMPLES, Daemon, free_port, overrides, thermogate
from support.waiting import wait_until

EXAMPLE = EXAMPLES / "zenoh.toml"


@pytest.fixture(scope="module")
def place() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture(scope="module")
def bms(place: str) -> Iterator[Bms]:
    with simulated("--zones", 2, "--pace", 60, "--zenoh", place) as running:
        yield running


@pytest.fixture(scope="module")
def plant(bms: Bms, place: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Bms, Daemon, str]]:
    """The building, and the daemon on the example with a period of 2 s."""
    folder = tmp_path_factory.mktemp("plant")
    ours = f"tcp/127.0.0.1:{free_port()}"
    settings: dict[str, object] = {
        "site.state_dir": str(folder / "state"),
        "sources.bms.connect": [place],
        "zenoh.enabled": True,
        "zenoh.listen": [ours],
        "zones.0.period": "2s",
        "zones.0.lateness": "0s",
        "zones.0.hold_inputs": "30s",
        "zones.0.estimator_options.particles": 200,
    }
    with Daemon(EXAMPLE, folder / "log", settings) as daemon:
        daemon.wait(lambda zones: zones["room2"]["samples"] >= 3)
        yield bms, daemon, ours


def stale(found: dict) -> set[str]:
    return {one["channel"] for one in found["channels"] if one["stale"]}


def truth(bms: Bms) -> dict:
    with urllib.request.urlopen(f"{bms.control}/state", timeout=180) as answer:
        return json.load(answer)


def test_the_room_is_heard_and_forecast(plant: tuple[Bms, Daemon, str]) -> None:
    bms, daemon, _ = plant
    code, forecast = daemon.get("/zones/room2/forecast")
    assert code == 200
    assert forecast["mean"] == pytest.approx(truth(bms)["rooms"]["room2"]["T_air"], abs=2.0)
    assert [used["held"] for used in forecast["inputs"]] == [False, False]
    # What the caches bring at the start may be older than the intervals that are open then.
    assert daemon.status("room2")["faults"].keys() <= {"out_of_order"}


@pytest.mark.parametrize(("leap", "fault"), [(3600, "ahead_of_time"), (-3600, "out_of_order")])
def test_a_leap_of_the_devices_clock_makes_its_channels_stale_and_passes(
    leap: float, fault: str, plant: tuple[Bms, Daemon, str]
) -> None:
    bms, daemon, ours = plant
    daemon.until("room2", lambda found: not stale(found))
    made = bms.post("/faults", {"kind": "clock-jump", "device": "room2", "value": leap})
    found = daemon.until("room2", lambda found: stale(found) == {"T_i", "u_heat"})
    assert found["faults"][fault] > 0
    # REST says how old a channel is now, Zenoh how old it was when the zone last announced itself.
    wait_until(lambda: heard_on_zenoh(ours) == {"T_i", "u_heat"})
    held = {used["channel"]: used["held"] for used in daemon.get("/zones/room2/forecast")[1]["inputs"]}
    assert held == {"T_out": False, "u_heat": True}
    urllib.request.urlopen(urllib.request.Request(f"{bms.control}/faults/{made['id']}", method="DELETE")).close()
    daemon.until("room2", lambda found: not stale(found))


def heard_on_zenoh(ours: str) -> set[str]:
    """The channels that the zone's status on Zenoh says are stale."""
    config = zenoh.Config()
    for key, value in {"mode": "client", "connect/endpoints": [ours], "scouting/multicast/enabled": False}.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        (reply,) = list(session.get("thermogate/plant/room2/status", timeout=180))
        return stale(json.loads(reply.ok.payload.to_string()))


def test_no_value_is_not_available_and_not_zero(plant: tuple[Bms, Daemon, str]) -> None:
    bms, daemon, _ = plant
    daemon.until("room2", lambda found: not stale(found))
    bms.post("/faults", {"kind": "nan", "device": "room2", "channel": "heat_power", "for": 6})
    found = daemon.until("room2", lambda found: stale(found) == {"u_heat"})
    assert found["faults"]["not_available"] > 0
    daemon.until("room2", lambda found: not stale(found))


def test_probe_shows_every_channel(bms: Bms, place: str) -> None:
    done = thermogate("probe", EXAMPLE, "--seconds", 8, *overrides({"sources.bms.connect": [place]}))
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == f"source bms: client connecting to {place}"
    assert lines[1].split() == ["channel", "where", "raw", "value", "unit", "age", "verdict"]
    channels = [line.split()[0] for line in lines if line.startswith("room2/")]
    assert channels == ["room2/T_i", "room2/T_out", "room2/u_heat"]
    assert all(line.endswith("good") for line in lines if line.startswith("room2/"))
    assert done.stdout.count("by its payload") == 2
    assert done.stdout.count("by Zenoh's time stamp") == 1


def test_probe_of_a_wrong_key_fails_and_names_it(bms: Bms, place: str) -> None:
    changes = {"sources.bms.connect": [place], "zones.0.channels.T_out.key": "bms/plain/weather/Tout"}
    done = thermogate("probe", EXAMPLE, "--seconds", 2, *overrides(changes))
    assert done.returncode == 1
    assert "nothing came within 2 s" in done.stdout
    assert "bms/plain/weather/T_out" in done.stdout, "a key that is heard is offered"


def test_the_building_goes_and_comes_back(tmp_path: Path) -> None:
    place = f"tcp/127.0.0.1:{free_port()}"
    settings: dict[str, object] = {
        "site.state_dir": str(tmp_path / "state"),
        "sources.bms.connect": [place],
        "zones.0.period": "1s",
        "zones.0.hold_inputs": "5s",
        "zones.0.max_gap": 3,
        "zones.0.lateness": "0s",
        "zones.0.estimator_options.particles": 100,
    }
    arguments = ("--zones", 2, "--pace", 60, "--zenoh", place)
    with Daemon(EXAMPLE, tmp_path / "log", settings) as daemon:
        daemon.wait(lambda zones: "no Zenoh session answers" in zones["room2"]["reason"])
        for _ in range(2):
            with simulated(*arguments):
                daemon.wait(lambda zones: zones["room2"]["state"] == "running")
            daemon.wait(lambda zones: zones["room2"]["state"] == "stalled")
        code = daemon.terminate()
        assert code == 0, daemon.log()
