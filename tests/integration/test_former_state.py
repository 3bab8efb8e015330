"""State of before the default bank had blind regressions goes on in the daemon of today: nothing lost, no new segment.

`former-state.tar.xz` holds a configuration, its recording, and the state folder of a daemon of commit 65b4a18 that was
killed with SIGKILL in mid-recording. Of its checkpoints the newest of each zone is kept; its journal is still
in the write-ahead log.
"""

import re
import sqlite3
import tarfile
from contextlib import closing
from pathlib import Path

import pytest
from support.harness import Daemon, thermogate
from support.sites import Table, replayed

ARCHIVE = Path(__file__).with_name("former-state.tar.xz")
SAMPLES, RECORDED = 132, 192
"""Samples of each zone in the journal, and in the whole recording."""
BEYOND = {"room-1": 10, "room-2": 5, "room-3": 17, "room-4": 25}
"""Samples of each zone in the journal that are later than its checkpoint."""
ESTIMATORS = {"room-1": "rbpf", "room-2": "ekf", "room-3": "bank", "room-4": "bank"}


def site(folder: Path) -> Path:
    """The configuration in `folder`, beside its recording and the state folder."""
    with tarfile.open(ARCHIVE) as archive:
        archive.extractall(folder, filter="data")
    return folder / "config.toml"


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Table]]:
    """The rows of every zone when `thermogate replay` runs the whole recording with the code of today."""
    folder = tmp_path_factory.mktemp("straight")
    return replayed(site(folder), folder / "out")


@pytest.mark.parametrize("restored", [False, True], ids=["as it was left", "restored from a backup"])
def test_the_daemon_of_today_goes_on(straight: dict[str, list[Table]], restored: bool, tmp_path: Path) -> None:
    config, settings = site(tmp_path / "site"), {}
    for zone, estimator in ESTIMATORS.items():
        (checkpoint,) = (config.parent / "state" / "checkpoints" / zone).glob("*.npz")
        shown = thermogate("inspect", checkpoint)
        assert (shown.returncode, shown.stderr) == (0, "")
        told = (rf"zone +{zone}", rf"estimator +{estimator}", "period +900 s", "digest +right")
        for line in (*told, r"written by +Thermogate 0\.1\.0, format 1"):
            assert re.search(rf"^{line}$", shown.stdout, re.MULTILINE), (line, shown.stdout)
    if restored:
        kept, place = tmp_path / "kept.tar", str(tmp_path / "restored")
        done = thermogate("backup", config, kept)
        assert (done.returncode, done.stderr) == (0, "")
        assert "zones with a checkpoint: 4" in done.stdout
        settings = {"site.state_dir": place}
        done = thermogate("restore", config, kept, "--set", f'site.state_dir="{place}"')
        assert (done.returncode, done.stderr) == (0, "")
    with closing(sqlite3.connect(config.parent / "state" / "journal.sqlite3")) as journal:
        query = "SELECT y, mean, gate FROM history WHERE zone = ? ORDER BY time"
        before = {zone: journal.execute(query, (zone,)).fetchall() for zone in BEYOND}
    with Daemon(config, tmp_path / "log", settings) as daemon:
        daemon.wait_until_ended()
        log = daemon.log()
        for zone, beyond in BEYOND.items():
            # A checkpoint that could not be used would cost no sample: the journal has them all. It would show here.
            assert f"zone '{zone}' goes on after {SAMPLES} samples, {beyond} intervals replayed from the journal" in log
            history = daemon.history(zone)
            assert [row["time"] for row in history] == [row["time"] for row in straight[zone]]
            assert len(history) == RECORDED
            known = SAMPLES - beyond
            kept_rows = [tuple(row[name] for name in ("y", "mean", "gate")) for row in history[:known]]
            assert kept_rows == before[zone][:known], "bit for bit"
            for row, other in zip(history[known:], straight[zone][known:], strict=True):
                # Today's code goes on near, and not at, the numbers of code that sums or draws in another way.
                assert row["y"] == other["y"]
                assert row["mean"] == pytest.approx(other["mean"], abs=other["sd"])
                assert 0.5 < row["sd"] / other["sd"] < 2.0
            status = daemon.status(zone)
            assert (status["samples"], status["segment"]) == (RECORDED, 1)
            # At the end of its recording a zone no longer vouches for its forecast.
            assert daemon.get(f"/zones/{zone}/forecast")[1]["quality"] == "bad"
        assert not re.search("damaged|corrupt|Traceback| ERROR ", log), log
