"""The daemon on a disk that is full, or read-only: one sentence, nothing lost, and it goes on by itself."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.harness import EXAMPLES, Daemon
from support.sites import replayed, same_history, simulation

CONFIG = EXAMPLES / "building-67.toml"
ZONE = "building-67"


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 12 MB: the write-ahead log alone takes 4."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=12m", "thermogate-test", folder]
    if subprocess.run(command, capture_output=True, check=False).returncode != 0:
        pytest.skip("mounting a small disk needs root, outside of a container")
    yield folder
    subprocess.run(["umount", folder], check=True)


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


def refused(disk: Path, log: Path) -> str:
    """The one sentence with which a start on `disk` ends."""
    with Daemon(CONFIG, log, simulation(disk / "state")) as daemon:
        assert daemon.process.wait(180) == 1
        assert "Traceback" not in daemon.log()
        (sentence,) = [line for line in daemon.log().splitlines() if line.startswith("thermogate:")]
        return sentence


def test_a_disk_that_takes_nothing_stops_samples_and_nothing_else_and_loses_nothing(disk: Path, tmp_path: Path) -> None:
    rows = replayed(CONFIG, tmp_path / "out", {"zones.0.estimator_options.particles": 200})[ZONE]
    ballast = fill(disk)
    sentence = refused(disk, tmp_path / "full.log")
    assert str(disk) in sentence
    assert "free space on its disk: what was set aside" in sentence
    ballast.unlink()
    with Daemon(CONFIG, tmp_path / "log", simulation(disk / "state")) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 40)
        ballast = fill(disk)
        daemon.says("cannot accept samples")
        assert "free space on its disk" in daemon.log()
        assert daemon.get(f"/zones/{ZONE}/forecast")[0] == 200
        assert daemon.get("/healthz")[0] == 200
        ballast.unlink()
        samples = daemon.status(ZONE)["samples"]
        daemon.wait(lambda zones: zones[ZONE]["samples"] > samples + 20)
        assert "Traceback" not in daemon.log()
        daemon.kill()
    before = {path: path.read_bytes() for path in disk.rglob("*") if path.is_file() and path.suffix != ".sqlite3-shm"}
    subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
    assert "Read-only file system" in refused(disk, tmp_path / "read-only.log")
    assert {path: path.read_bytes() for path in before} == before
    subprocess.run(["mount", "-o", "remount,rw", disk], check=True)
    with Daemon(CONFIG, tmp_path / "last.log", simulation(disk / "state", pace="max")) as daemon:
        daemon.wait_until_ended()
        same_history(daemon, ZONE, rows)
        assert daemon.terminate() == 0
