"""Stopped or killed in mid-replay, the daemon goes on as if it had never stopped."""

import contextlib
import csv
import http.client
import signal
import threading
import time

import pytest
from support.harness import EXAMPLES, Daemon, overrides, thermogate
from support.waiting import wait_until

CONFIG = EXAMPLES / "building-67.toml"
ZONE = "building-67"
COLUMNS = ("y", "mean", "lower", "upper", "sd", "alpha_median", "cdf", "gate", "n_eff", "log_likelihood")


def settings(tmp_path):
    return {
        "site.state_dir": str(tmp_path / "state"),
        "zones.0.estimator_options.particles": 500,
        # About 60 samples a second: slow enough to be caught in the middle.
        "sources.simulation.pace": 36000,
    }


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    out = tmp_path_factory.mktemp("replay")
    done = thermogate("replay", CONFIG, "--out", out, *overrides({"zones.0.estimator_options.particles": 500}))
    assert done.returncode == 0, done.stderr
    with (out / ZONE / "updates.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 432
    return rows


def assert_same_history(daemon, rows):
    history = daemon.history(ZONE)
    assert [entry["time"] for entry in history] == [row["time"] for row in rows]
    for entry, row in zip(history, rows, strict=True):
        for name in COLUMNS:
            assert entry[name] == (float(row[name]) if row[name] else None), (row["time"], name)


def caught_in_the_middle(daemon, least):
    daemon.wait(lambda zones: zones[ZONE]["samples"] >= least)
    samples = daemon.get(f"/zones/{ZONE}")[1]["status"]["samples"]
    assert samples < 432
    return samples


def test_after_an_orderly_stop_the_next_start_goes_on(uninterrupted, tmp_path):
    with Daemon(CONFIG, tmp_path / "first.log", settings(tmp_path)) as daemon:
        samples = caught_in_the_middle(daemon, 60)
        code = daemon.terminate(signal.SIGTERM)
        assert code == 0, daemon.log()
        assert "Traceback" not in daemon.log()
    assert list((tmp_path / "state" / "checkpoints" / ZONE).glob("*.npz"))
    with Daemon(CONFIG, tmp_path / "second.log", settings(tmp_path)) as daemon:
        first = daemon.get(f"/zones/{ZONE}")[1]["status"]["samples"]
        assert first >= samples, "the zone starts where it stopped, before any new sample"
        assert "0 intervals replayed from the journal" in daemon.log()
        assert daemon.get(f"/zones/{ZONE}/forecast")[0] == 200, "its standing forecast is served at once"
        daemon.wait_until_ended()
        assert_same_history(daemon, uninterrupted)
        assert daemon.terminate(signal.SIGINT) == 0


def test_a_stop_does_not_wait_for_a_subscriber_that_never_comes(tmp_path):
    waiting = settings(tmp_path) | {"zenoh.enabled": True, "zenoh.listen": [], "zenoh.await_subscriber": "1h"}
    with Daemon(CONFIG, tmp_path / "log", waiting) as daemon:
        assert daemon.get("/zones")[1]["zones"][0]["state"] == "waiting"
        code = daemon.terminate()
    assert (code, "Traceback" in daemon.log()) == (0, False), daemon.log()


def test_a_stop_does_not_wait_for_a_long_forecast_or_a_long_queue(tmp_path):
    """Steps of a tenth of a second, sixteen of them in the mailbox, and a week's fan under way."""
    slow = settings(tmp_path) | {"zones.0.estimator_options.particles": 60000}
    with Daemon(CONFIG, tmp_path / "log", slow) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 3)

        def ask():
            # Whether it is refused or cut off is the daemon's affair.
            with contextlib.suppress(OSError, http.client.HTTPException):
                daemon.get(f"/zones/{ZONE}/forecast?horizon=7d")

        asking = threading.Thread(target=ask)
        asking.start()
        time.sleep(0.3)
        code = daemon.terminate()
        asking.join()
    assert (code, "Traceback" in daemon.log()) == (0, False), daemon.log()
    # Where the machine was too slow for a checkpoint as well, the journal has it all.
    with Daemon(CONFIG, tmp_path / "log", slow | {"sources.simulation.pace": 60}) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 3)
        assert "goes on after" in daemon.log()


def test_of_two_daemons_that_start_at_once_one_is_refused(tmp_path):
    for number in range(2):
        logs = [tmp_path / f"{number}-{which}.log" for which in "ab"]
        with Daemon(CONFIG, logs[0], settings(tmp_path)) as one, Daemon(CONFIG, logs[1], settings(tmp_path)) as other:
            (refused,) = wait_until(lambda: [each for each in (one, other) if each.process.poll() is not None])
            (served,) = {one, other} - {refused}
            assert refused.process.returncode == 1
            assert "another thermogate already runs on site.state_dir" in refused.log()
            assert "Traceback" not in refused.log()
            assert served.get("/healthz")[0] == 200
            served.kill()


def test_a_taken_port_is_one_sentence(tmp_path):
    with Daemon(CONFIG, tmp_path / "first.log", settings(tmp_path)) as first:
        port = int(first.url().rsplit(":", 1)[1])
        other = settings(tmp_path) | {"http.port": port, "site.state_dir": str(tmp_path / "other")}
        with Daemon(CONFIG, tmp_path / "second.log", other) as second:
            assert second.process.wait(timeout=180) == 1
            assert f"127.0.0.1:{port} cannot be used" in second.log()
            assert "Traceback" not in second.log()


def test_a_changed_network_is_refused_until_its_zone_is_reset(tmp_path):
    with Daemon(CONFIG, tmp_path / "first.log", settings(tmp_path)) as daemon:
        caught_in_the_middle(daemon, 30)
        assert daemon.terminate() == 0
    changed = settings(tmp_path)
    table = ("--set", 'zones.0.network={ preset = "building-67", fixed = ["C_s"] }')
    with Daemon(CONFIG, tmp_path / "second.log", changed, *table) as daemon:
        assert daemon.process.wait(timeout=180) in (1, 2)
        assert f"--reset {ZONE}" in daemon.log()
        assert "Traceback" not in daemon.log()
    with Daemon(CONFIG, tmp_path / "third.log", changed, *table, "--reset", ZONE) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 5)
        assert daemon.history(ZONE)[0]["segment"] == 1
        assert daemon.terminate() == 0
    # What was there is set aside, not deleted.
    assert list((tmp_path / "state" / "checkpoints").rglob("*.npz"))
