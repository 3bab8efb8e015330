"""State that the second generation wrote goes on in the daemon of today: nothing lost, no new segment.

`state-of-generation-2.tar.xz` holds a configuration, its recording, and the state folder of a daemon of commit d53cb45
that was killed with SIGKILL in mid-recording. Of its checkpoints the newest of each zone is kept; its journal is still
in the write-ahead log.
"""

from __future__ import annotations

import csv
import re
import sqlite3
import tarfile
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from support.harness import Daemon, thermogate

ARCHIVE = Path(__file__).with_name("state-of-generation-2.tar.xz")
SAMPLES, RECORDED = 119, 192
"""Samples of each zone in the journal, and in the whole recording."""
BEYOND = {"room-1": 10, "room-2": 6, "room-3": 5, "room-4": 25}
"""Samples of each zone in the journal that are later than its checkpoint."""


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """The configuration, beside its recording and the state folder."""
    with tarfile.open(ARCHIVE) as archive:
        archive.extractall(tmp_path / "site", filter="data")
    return tmp_path / "site" / "config.toml"


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[dict[str, Any]]]:
    """The rows of every zone when `thermogate replay` runs the whole recording with the code of today."""
    folder = tmp_path_factory.mktemp("straight")
    with tarfile.open(ARCHIVE) as archive:
        archive.extractall(folder, filter="data")
    done = thermogate("replay", folder / "config.toml", "--out", folder / "out")
    assert done.returncode == 0, done.stderr
    rows = {}
    for zone in BEYOND:
        with (folder / "out" / zone / "updates.csv").open(encoding="utf-8") as file:
            rows[zone] = [{name: number(cell) for name, cell in row.items()} for row in csv.DictReader(file)]
    return rows


def number(cell: str) -> object:
    """A cell of a replay as REST shows it."""
    if not cell:
        return None
    return cell if "T" in cell else float(cell)


def stored(site: Path) -> dict[str, list[tuple[float | None, ...]]]:
    """What the killed daemon had written of each zone: time, measured and forecast temperature."""
    with closing(sqlite3.connect(site.parent / "state" / "journal.sqlite3")) as journal:
        query = "SELECT time, y, mean, gate FROM history WHERE zone = ? ORDER BY time"
        return {zone: journal.execute(query, (zone,)).fetchall() for zone in BEYOND}


@pytest.mark.parametrize("restored", [False, True], ids=["as it was left", "restored from a backup"])
def test_the_daemon_of_today_goes_on(
    site: Path, straight: dict[str, list[dict[str, Any]]], restored: bool, tmp_path: Path
) -> None:
    settings = {}
    if restored:
        kept = tmp_path / "kept.tar"
        done = thermogate("backup", site, kept)
        assert (done.returncode, done.stderr) == (0, "")
        assert "zones with a checkpoint: 4" in done.stdout
        settings = {"site.state_dir": str(tmp_path / "restored")}
        done = thermogate("restore", site, kept, "--set", f'site.state_dir="{tmp_path / "restored"}"')
        assert (done.returncode, done.stderr) == (0, "")
    before = stored(site)
    with Daemon(site, tmp_path / "log", settings) as daemon:
        daemon.wait_until_ended()
        log = daemon.log()
        for zone, beyond in BEYOND.items():
            # A checkpoint that could not be used would cost no sample: the journal has them all. It would show here.
            assert f"zone '{zone}' goes on after {SAMPLES} samples, {beyond} intervals replayed from the journal" in log
            history = daemon.history(zone)
            assert [row["time"] for row in history] == [row["time"] for row in straight[zone]]
            assert len(history) == RECORDED
            known = SAMPLES - beyond
            kept = [tuple(row[name] for name in ("y", "mean", "gate")) for row in history[:known]]
            assert kept == [row[1:] for row in before[zone][:known]], "bit for bit"
            for row, other in zip(history[1:], straight[zone][1:], strict=True):
                # Code that sums or draws in another way goes on near, and not at, the same numbers.
                assert row["y"] == other["y"]
                assert row["mean"] == pytest.approx(other["mean"], abs=other["sd"])
                assert 0.5 < row["sd"] / other["sd"] < 2.0
            status = daemon.get(f"/zones/{zone}")[1]["status"]
            assert (status["samples"], status["segment"]) == (RECORDED, 1)
            # At the end of its recording a zone no longer vouches for its forecast.
            assert daemon.get(f"/zones/{zone}/forecast")[1]["quality"] == "bad"
        assert not re.search("damaged|corrupt|Traceback| ERROR ", log), log


@pytest.mark.parametrize(
    ("zone", "estimator"), [("room-1", "rbpf"), ("room-2", "ekf"), ("room-3", "bank"), ("room-4", "bank")]
)
def test_its_checkpoints_are_shown(site: Path, zone: str, estimator: str) -> None:
    (checkpoint,) = (site.parent / "state" / "checkpoints" / zone).glob("*.npz")
    shown = thermogate("inspect", checkpoint)
    assert (shown.returncode, shown.stderr) == (0, "")
    for line in (
        rf"zone +{zone}",
        rf"estimator +{estimator}",
        "period +900 s",
        r"written by +Thermogate 0\.1\.0, format 1",
        "digest +right",
    ):
        assert re.search(rf"^{line}$", shown.stdout, re.MULTILINE), (line, shown.stdout)
