"""The daemon on a disk that is full, or read-only: one sentence, nothing lost, and it goes on by itself."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.harness import EXAMPLES, Daemon
from support.waiting import wait_until

CONFIG = EXAMPLES / "building-67.toml"
ZONE = "building-67"


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 12 MB: the write-ahead log alone takes 4."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=12m", "thermogate-test", str(folder)], capture_output=True, check=False
    )
    if mounted.returncode != 0:
        pytest.skip("mounting a small disk needs root, outside of a container")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def settings(disk: Path, pace: object = 36000) -> dict[str, object]:
    return {
        "site.state_dir": str(disk / "state"),
        "site.checkpoint_every": 0.5,
        "zones.0.estimator_options.particles": 200,
        "sources.simulation.pace": pace,
    }


def fill(disk: Path) -> Path:
    """Take all the space there is."""
    ballast = disk / "ballast"
    with ballast.open("wb", buffering=0) as file:
        for size in (2**16, 2**12, 1):
            while True:
                try:
                    file.write(bytes(size))
                except OSError:
                    break
    return ballast


def test_a_full_disk_stops_samples_and_nothing_else_and_loses_nothing(disk: Path, tmp_path: Path) -> None:
    with Daemon(CONFIG, tmp_path / "log", settings(disk)) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 40)
        ballast = fill(disk)
        wait_until(lambda: "cannot accept samples" in daemon.log(), daemon.log)
        assert "free space on its disk" in daemon.log()
        assert daemon.get(f"/zones/{ZONE}/forecast")[0] == 200
        assert daemon.get("/healthz")[0] == 200
        ballast.unlink()
        daemon.wait_until_ended()
        full = daemon.history(ZONE)
        assert "Traceback" not in daemon.log()
        assert daemon.terminate() == 0
    alone = settings(tmp_path, "max")
    with Daemon(CONFIG, tmp_path / "alone.log", alone) as daemon:
        daemon.wait_until_ended()
        assert daemon.history(ZONE) == full


def test_a_start_on_a_full_disk_is_one_sentence_or_waits_for_space(disk: Path, tmp_path: Path) -> None:
    ballast = fill(disk)
    with Daemon(CONFIG, tmp_path / "log", settings(disk)) as daemon:
        assert daemon.process.wait(180) == 1
        (sentence,) = [line for line in daemon.log().splitlines() if line.startswith("thermogate:")]
        assert str(disk) in sentence
        assert "free space on its disk: what was set aside" in sentence
        assert "Traceback" not in daemon.log()
    ballast.unlink()
    with Daemon(CONFIG, tmp_path / "log", settings(disk, "max")) as daemon:
        daemon.wait_until_ended()


def test_a_start_on_a_read_only_disk_is_one_sentence(disk: Path, tmp_path: Path) -> None:
    with Daemon(CONFIG, tmp_path / "first.log", settings(disk)) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 20)
        daemon.kill()
    before = {path: path.read_bytes() for path in disk.rglob("*") if path.is_file() and path.suffix != ".sqlite3-shm"}
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
    with Daemon(CONFIG, tmp_path / "second.log", settings(disk)) as daemon:
        assert daemon.process.wait(180) == 1
        (sentence,) = [line for line in daemon.log().splitlines() if line.startswith("thermogate:")]
        assert "Read-only file system" in sentence
    assert {path: path.read_bytes() for path in before} == before
    subprocess.run(["mount", "-o", "remount,rw", str(disk)], check=True)
    with Daemon(CONFIG, tmp_path / "third.log", settings(disk, "max")) as daemon:
        daemon.wait_until_ended()
        assert os.access(disk, os.W_OK)
