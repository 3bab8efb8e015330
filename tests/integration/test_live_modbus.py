"""The daemon on live Modbus: forecasts, a sensor that goes stale, a device that goes away and comes back."""

import json
import threading
from datetime import datetime, timedelta
from pathlib import Path

import pytest
import zenoh
from support.harness import Daemon
from support.modbus_plant import WORDS, configuration, plant, running
from support.waiting import wait_until
from support.zenoh_plant import endpoint, session

ZONE = "zone-bms"


def stale(status: dict) -> set[str]:
    return {one["channel"] for one in status["channels"] if one["stale"]}


def held(daemon: Daemon) -> tuple[list[bool], str]:
    """Which inputs of the forecast are held, and its quality."""
    _, forecast = daemon.get(f"/zones/{ZONE}/forecast")
    return [used["held"] for used in forecast["inputs"]], forecast["quality"]


def test_a_refused_register_shows_as_stale_and_held_while_the_forecasts_go_on(tmp_path: Path) -> None:
    place, refusing, seen = endpoint(), threading.Event(), threading.Event()
    first: dict = {}

    def note(sample: zenoh.Sample) -> None:
        status = json.loads(sample.payload.to_bytes())
        if refusing.is_set() and not seen.is_set() and "T_out" in stale(status):
            first.update(status)
            seen.set()

    settings = {"zenoh.enabled": True, "zenoh.listen": [], "zenoh.connect": [place]}
    with running(plant(holding=WORDS)) as site, session(listen=place) as heard:
        subscriber = heard.declare_subscriber(f"thermogate/plant/{ZONE}/status", note)
        with Daemon(configuration(tmp_path, {"bms": site.port}), tmp_path / "log", settings) as daemon:
            daemon.until(ZONE, lambda found: found["samples"] >= 3 and not stale(found))
            assert daemon.get(f"/zones/{ZONE}/forecast")[1]["mean"] == pytest.approx(21.5, abs=1.0)
            wait_until(lambda: held(daemon) == ([False, False], "good"))

            refusing.set()
            site.refused.add((1, "holding", 1))
            status = daemon.until(ZONE, lambda found: stale(found) == {"T_out"} and found["state"] == "running")
            assert status["faults"]["refused_by_device"] >= 1
            # The forecast says what is held.
            wait_until(lambda: held(daemon) == ([True, False], "uncertain"))
            # It reaches Zenoh with the first interval that lacks the channel.
            assert seen.wait(180), daemon.log()
            (told,) = (one["last_good"] for one in first["channels"] if one["channel"] == "T_out")
            last_good = datetime.fromisoformat(told)
            assert datetime.fromisoformat(first["last_sample_time"]) - last_good <= timedelta(seconds=1), "one period"
            assert daemon.terminate() == 0
        subscriber.undeclare()
        assert site.codes == {3}, "of all the frames that the daemon sent"
        assert f"the device refuses {ZONE}/T_out (unit 1 holding 1): exception 2" in daemon.log()
        assert "Traceback" not in daemon.log()
