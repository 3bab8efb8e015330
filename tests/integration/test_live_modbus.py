"""The daemon on live Modbus: forecasts, a sensor that goes stale, a device that goes away and comes back, a probe."""

from __future__ import annotations

import json
import threading
from datetime import datetime, timedelta
from pathlib import Path

import pytest
import zenoh
from support.harness import Daemon, free_port, thermogate
from support.live_modbus import WORDS, configuration, running
from support.modbus_plant import plant
from support.waiting import wait_until
from support.zenoh_plant import session


def channel(status: dict, name: str) -> dict:
    return next(one for one in status["channels"] if one["channel"] == name)


def is_running(status: dict) -> bool:
    return status["state"] == "running"


def is_without_outdoor_temperature(status: dict) -> bool:
    """Not merely behind its samples of every second, as it may be at times on a busy machine."""
    return status["state"] == "stalled" and "T_out is" in status["reason"]


def held(daemon: Daemon) -> tuple[list[bool], str]:
    """Which inputs of the forecast are held, and its quality."""
    _, forecast = daemon.get("/zones/zone-bms/forecast")
    return [used["held"] for used in forecast["inputs"]], forecast["quality"]


def test_a_refused_register_shows_as_stale_and_held_while_the_forecasts_go_on(tmp_path: Path) -> None:
    with running(plant(holding=WORDS)) as site:
        config = configuration(tmp_path, {"bms": site.port})
        with Daemon(config, tmp_path / "log") as daemon:
            daemon.until(
                "zone-bms",
                lambda status: status["samples"] >= 3 and not any(one["stale"] for one in status["channels"]),
            )
            assert daemon.get("/zones/zone-bms/forecast")[1]["mean"] == pytest.approx(21.5, abs=1.0)
            wait_until(lambda: held(daemon) == ([False, False], "good"))

            site.refused.add((1, "holding", 1))
            status = daemon.until(
                "zone-bms",
                lambda status: (
                    channel(status, "T_out")["stale"] and not channel(status, "T_i")["stale"] and is_running(status)
                ),
            )
            assert status["faults"]["refused_by_device"] >= 1
            # The forecast says what is held.
            wait_until(lambda: held(daemon) == ([True, False], "uncertain"))

            daemon.until("zone-bms", is_without_outdoor_temperature)
            assert daemon.terminate() == 0
        assert site.codes == {3}, "of all the frames that the daemon sent"
        assert "the device refuses zone-bms/T_out (unit 1 holding 1): exception 2" in daemon.log()
        assert "Traceback" not in daemon.log()


def test_staleness_reaches_zenoh_with_the_first_interval_that_lacks_the_channel(tmp_path: Path) -> None:
    endpoint, refusing, seen = f"tcp/127.0.0.1:{free_port()}", threading.Event(), threading.Event()
    first: dict = {}

    def note(sample: zenoh.Sample) -> None:
        status = json.loads(sample.payload.to_bytes())
        if refusing.is_set() and not seen.is_set() and channel(status, "T_out")["stale"]:
            first.update(status)
            seen.set()

    with running(plant(holding=WORDS)) as site, session(listen=endpoint) as heard:
        subscriber = heard.declare_subscriber("thermogate/plant/zone-bms/status", note)
        settings = {"zenoh.enabled": True, "zenoh.listen": [], "zenoh.connect": [endpoint]}
        with Daemon(configuration(tmp_path, {"bms": site.port}), tmp_path / "log", settings) as daemon:
            daemon.until("zone-bms", lambda status: status["samples"] >= 2)
            refusing.set()
            site.refused.add((1, "holding", 1))
            assert seen.wait(180), daemon.log()
        subscriber.undeclare()
    last_good = datetime.fromisoformat(channel(first, "T_out")["last_good"])
    assert datetime.fromisoformat(first["last_sample_time"]) - last_good <= timedelta(seconds=1), "one period"


def test_a_probe_prints_a_table_and_fails_where_something_is_wrong(tmp_path: Path) -> None:
    with running(plant(holding=WORDS)) as site:
        config = configuration(tmp_path, {"bms": site.port})
        done = thermogate("probe", config)
        assert (done.returncode, done.stderr) == (0, "")
        title, header, *rows = done.stdout.splitlines()
        assert title == f"source bms: tcp 127.0.0.1:{site.port}, polled every 0.2s"
        assert header.split() == ["channel", "where", "raw", "value", "unit", "age", "verdict"]
        assert rows[0].startswith("zone-bms/T_i")
        assert "unit 1 holding 0 int16   0x00d7  21.5   degC" in rows[0]
        assert all(row.endswith(" s  good") for row in rows)

        site.registers[1, "holding"][0] = 0xD700
        wrong = thermogate("probe", config, "--source", "bms")
        assert site.codes <= {3, 4}, "a probe only reads, also where it looks for the register that was meant"
        assert wrong.returncode == 1
        assert "implausible: not within -60 to 80\n    BADC would be 21.5, which is plausible" in wrong.stdout
    gone = thermogate("probe", config)
    assert gone.returncode == 1
    assert gone.stdout == ""
    assert gone.stderr.startswith(f"thermogate: sources.bms: no connection to 127.0.0.1:{site.port}; check")
    assert len(gone.stderr.splitlines()) == 1


def test_a_probe_of_a_recording_shows_its_ends() -> None:
    done = thermogate("probe", Path(__file__).parents[2] / "deploy" / "examples" / "generic-csv.toml")
    assert done.returncode == 0
    assert [line.split("  ")[0] for line in done.stdout.splitlines()[2:4]] == ["room-1/T_i", "room-1/T_i"]
    assert "Raumtemperatur, first row" in done.stdout
    assert "Raumtemperatur, last row" in done.stdout


def test_only_recordings_can_be_replayed(tmp_path: Path) -> None:
    done = thermogate("replay", configuration(tmp_path, {"bms": 502}), "--out", tmp_path / "out")
    assert done.returncode == 1
    assert done.stderr.startswith(
        "thermogate: sources.bms is live (modbus), and only recorded sources can be replayed;"
    )
