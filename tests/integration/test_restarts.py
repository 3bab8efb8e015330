"""Stopped, killed, refused, backed up: a daemon in mid-replay goes on as if it had never stopped."""

import contextlib
import http.client
import re
import signal
import threading
import time
from pathlib import Path

import pytest
from support.harness import EXAMPLES, Daemon, overrides, thermogate
from support.sites import Table, replayed, same_history, simulation
from support.waiting import wait_until

CONFIG = EXAMPLES / "building-67.toml"
ZONE = "building-67"


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> list[Table]:
    """What `thermogate replay` makes of the whole recording."""
    out = tmp_path_factory.mktemp("replay")
    (rows,) = replayed(CONFIG, out, {"zones.0.estimator_options.particles": 200}).values()
    assert len(rows) == 432
    return rows


def test_one_daemon_at_a_time_goes_on_where_it_was_stopped(uninterrupted: list[Table], tmp_path: Path) -> None:
    state = simulation(tmp_path / "state")
    # Of two that start at once one is refused.
    with Daemon(CONFIG, tmp_path / "one.log", state) as one, Daemon(CONFIG, tmp_path / "other.log", state) as other:
        (refused,) = wait_until(lambda: [each for each in (one, other) if each.process.poll() is not None])
        (daemon,) = {one, other} - {refused}
        assert refused.process.returncode == 1
        assert "another thermogate already runs on site.state_dir" in refused.log()
        # A port that is taken is one sentence.
        port = int(daemon.url().rsplit(":", 1)[1])
        with Daemon(CONFIG, tmp_path / "third.log", simulation(tmp_path / "third") | {"http.port": port}) as third:
            assert third.process.wait(timeout=180) == 1
            assert f"127.0.0.1:{port} cannot be used" in third.log()
        samples = daemon.wait(lambda zones: zones[ZONE]["samples"] >= 60)[ZONE]["samples"]
        assert samples < 432
        assert daemon.terminate() == 0, daemon.log()
        for each in (refused, third, daemon):
            assert "Traceback" not in each.log()
        hurried = "stopping before every mailbox was empty" in daemon.log()
    assert list((tmp_path / "state" / "checkpoints" / ZONE).glob("*.npz"))
    # A changed network is refused until its zone is reset.
    changed = ("--set", 'zones.0.network={ preset = "building-67", fixed = ["C_s"] }')
    with Daemon(CONFIG, tmp_path / "changed.log", state, *changed) as daemon:
        assert daemon.process.wait(timeout=180) in (1, 2)
        assert f"--reset {ZONE}" in daemon.log()
        assert "Traceback" not in daemon.log()
    with Daemon(CONFIG, tmp_path / "next.log", state) as daemon:
        status = daemon.status(ZONE)
        assert status["samples"] >= samples, "the zone starts where it stopped, before any new sample"
        assert hurried or "0 intervals replayed from the journal" in daemon.log()
        assert daemon.get(f"/zones/{ZONE}/forecast")[0] == 200, "its standing forecast is served at once"
        daemon.wait_until_ended()
        same_history(daemon, ZONE, uninterrupted)
        assert daemon.terminate(signal.SIGINT) == 0
    with Daemon(CONFIG, tmp_path / "reset.log", state, *changed, "--reset", ZONE) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 5)
        assert daemon.history(ZONE)[0]["segment"] == 1
        assert daemon.terminate() == 0
    # What was there is set aside, not deleted.
    assert list((tmp_path / "state" / "checkpoints").rglob("*.npz"))


def test_a_stop_does_not_wait_for_a_subscriber_that_never_comes(tmp_path: Path) -> None:
    waiting = {"zenoh.enabled": True, "zenoh.listen": [], "zenoh.await_subscriber": "1h"}
    with Daemon(CONFIG, tmp_path / "log", simulation(tmp_path / "state") | waiting) as daemon:
        assert daemon.get("/zones")[1]["zones"][0]["state"] == "waiting"
        assert daemon.terminate() == 0
        assert "Traceback" not in daemon.log()


def test_a_stop_does_not_wait_for_a_long_forecast_or_a_long_queue(tmp_path: Path) -> None:
    """Steps of a tenth of a second, sixteen of them in the mailbox, and a week's fan under way."""
    slow = simulation(tmp_path / "state") | {"zones.0.estimator_options.particles": 60000}
    with Daemon(CONFIG, tmp_path / "log", slow) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 3)

        def ask() -> None:
            # Whether it is refused or cut off is the daemon's affair.
            with contextlib.suppress(OSError, http.client.HTTPException):
                daemon.get(f"/zones/{ZONE}/forecast?horizon=7d")

        asking = threading.Thread(target=ask)
        asking.start()
        time.sleep(0.3)
        assert daemon.terminate() == 0
        asking.join()
        assert "Traceback" not in daemon.log()


def test_a_backup_of_a_running_daemon_goes_on_bit_for_bit(uninterrupted: list[Table], tmp_path: Path) -> None:
    """With `thermogate report`."""
    live, restored = simulation(tmp_path / "live"), simulation(tmp_path / "restored", pace="max")
    kept = tmp_path / "kept.tar"
    with Daemon(CONFIG, tmp_path / "first.log", live) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 80)
        done = thermogate("backup", CONFIG, kept, *overrides(live))
        assert (done.returncode, done.stderr) == (0, "")
        assert re.fullmatch(rf"{kept}: site semi-synthetic, \d+\.\d MB, zones with a checkpoint: 1\n", done.stdout)
        refused = thermogate("restore", CONFIG, kept, "--replace", *overrides(live))
        assert refused.returncode == 1
        assert "another thermogate already runs on site.state_dir" in refused.stderr
        daemon.wait_until_ended()
        same_history(daemon, ZONE, uninterrupted)
        forecast = daemon.get(f"/zones/{ZONE}/forecast")
        done = thermogate("report", tmp_path / "live", "--out", tmp_path / "report")
        assert daemon.process.poll() is None
        assert "Traceback" not in daemon.log()
    assert done.returncode == 0, done.stderr
    (row,) = [line.split() for line in done.stdout.splitlines() if line.startswith(f"{ZONE}  one step")]
    assert 0 < int(row[3]) <= len(uninterrupted)
    assert "bit for bit" in (tmp_path / "report" / "report.html").read_text()
    told = f'thermogate: --zone: there is no zone "attic"; the zones are {ZONE}\n'
    wrong = thermogate("report", tmp_path / "live", "--zone", "attic")
    assert (wrong.returncode, wrong.stderr) == (2, told)
    nothing = thermogate("report", tmp_path / "elsewhere")
    assert (nothing.returncode, "there is no configuration.toml in" in nothing.stderr) == (1, True)
    done = thermogate("restore", CONFIG, kept, *overrides(restored))
    assert (done.returncode, done.stderr) == (0, "")
    assert "as it was at" in done.stdout
    with Daemon(CONFIG, tmp_path / "second.log", restored) as daemon:
        assert "intervals replayed from the journal" in (daemon.url() and daemon.log())
        daemon.wait_until_ended()
        same_history(daemon, ZONE, uninterrupted)
        assert daemon.get(f"/zones/{ZONE}/forecast") == forecast
        assert "goes on after" in daemon.log()
