"""The daemon on live Zenoh: the example learns the simulated building, faults stay where they are, a probe."""

import json
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from support.bms_process import Bms
from support.harness import EXAMPLES, Daemon
from support.waiting import wait_until
from support.zenoh_plant import endpoint, session

EXAMPLE = EXAMPLES / "zenoh.toml"


@pytest.fixture(scope="module")
def place() -> str:
    return endpoint()


@pytest.fixture(scope="module")
def bms(place: str) -> Iterator[Bms]:
    with Bms("--zones", 2, "--pace", 60, "--zenoh", place) as running:
        yield running


def stale(found: dict) -> set[str]:
    return {one["channel"] for one in found["channels"] if one["stale"]}


def test_a_room_is_forecast_and_its_faults_are_told(bms: Bms, place: str, tmp_path: Path) -> None:
    ours = endpoint()
    settings: dict[str, object] = {
        "zones.0.lateness": "0s",
        "zones.0.estimator_options.particles": 100,
        "site.state_dir": str(tmp_path / "state"),
        "sources.bms.connect": [place],
        "zenoh.enabled": True,
        "zenoh.listen": [ours],
        "zones.0.period": "2s",
        "zones.0.hold_inputs": "30s",
    }
    with Daemon(EXAMPLE, tmp_path / "log", settings) as daemon, ExitStack() as stack:
        daemon.wait(lambda zones: zones["room2"]["samples"] >= 3)
        listening = stack.enter_context(session("client", connect=ours))
        code, forecast = daemon.get("/zones/room2/forecast")
        assert code == 200
        assert forecast["mean"] == pytest.approx(bms.get("/state")["rooms"]["room2"]["T_air"], abs=2.0)
        assert [used["held"] for used in forecast["inputs"]] == [False, False]
        # What the caches bring at the start may be older than the intervals that are open then.
        assert daemon.status("room2")["faults"].keys() <= {"out_of_order"}

        def on_zenoh() -> set[str]:
            (reply,) = list(listening.get("thermogate/plant/room2/status", timeout=180))
            return stale(json.loads(reply.ok.payload.to_string()))

        for leap, fault in ((3600, "ahead_of_time"), (-3600, "out_of_order")):
            daemon.until("room2", lambda found: not stale(found))
            bms.break_down("clock-jump", "room2", value=leap)
            found = daemon.until("room2", lambda found: stale(found) == {"T_i", "u_heat"})
            assert found["faults"][fault] > 0
            # REST says how old a channel is now, Zenoh how old it was when the zone last announced itself.
            wait_until(lambda: on_zenoh() == {"T_i", "u_heat"})
            held = {used["channel"]: used["held"] for used in daemon.get("/zones/room2/forecast")[1]["inputs"]}
            assert held == {"T_out": False, "u_heat": True}
            bms.mend()
        daemon.until("room2", lambda found: not stale(found))
        bms.break_down("nan", "room2", channel="heat_power", **{"for": 6})
        found = daemon.until("room2", lambda found: stale(found) == {"u_heat"})
        assert found["faults"]["not_available"] > 0, "no value is not zero"
        daemon.until("room2", lambda found: not stale(found))
