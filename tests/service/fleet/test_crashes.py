"""Whoever brings down its process again and again is found, and nobody else."""

import errno
import json
import logging
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from service.fleet.shards.crashes import MOST, Crashes

DYING = """
    import os, sys, threading
    from pathlib import Path
    from service.fleet.shards.crashes import Crashes

    crashes = Crashes("campus", "shard-0", Path(sys.argv[1]))
    at_work = threading.Barrier(2)

    def innocent():
        with crashes.stepping("attic", 600):
            pass
        at_work.wait()

    thread = threading.Thread(target=innocent)
    thread.start()
    at_work.wait()
    with crashes.stepping("cellar", int(sys.argv[2])):
        os.kill(os.getpid(), 9)
"""


def die(folder: Path, time: int) -> None:
    """A process that is ended while the cellar is at work with the sample at `time`."""
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(DYING), str(folder), str(time)], check=False)
    assert done.returncode == -9


def test_the_zone_that_was_at_work_is_guilty_after_some_processes_at_one_sample(tmp_path: Path) -> None:
    die(tmp_path, 600)
    for crashes in range(1, MOST + 1):
        die(tmp_path, 1200)
        found = Crashes("campus", "shard-0", tmp_path)
        assert found.suspects == (("cellar", 1200, crashes),)
        assert found.guilty.keys() == ({"cellar"} if crashes == MOST else set())
        # As it was: reading begins new notes.
        (tmp_path / "campus.shard-0.steps").write_text(json.dumps([("cellar", 1200, crashes - 1)]) + "\n")


def test_an_error_that_the_process_survives_or_an_end_in_order_is_no_crash(tmp_path: Path) -> None:
    crashes = Crashes("campus", "shard-0", tmp_path)
    with pytest.raises(ValueError, match="of its own"), crashes.stepping("cellar", 600):
        raise ValueError("of its own")
    assert Crashes("campus", "shard-0", tmp_path).suspects == ()
    die(tmp_path, 1200)
    Crashes("campus", "shard-0", tmp_path).close()
    assert Crashes("campus", "shard-0", tmp_path).suspects == ()


GUILTY = b'[["cellar", 1200, 9]]\n'


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"cellar x".ljust(128), b'[["a"]]', GUILTY])
def test_a_file_that_is_damaged_or_others_can_change_blames_nobody(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "campus.shard-0.steps").write_bytes(content)
    tmp_path.chmod(0o777 if content == GUILTY else 0o700)
    assert Crashes("campus", "shard-0", tmp_path).suspects == ()


def test_a_folder_that_cannot_be_written_costs_the_notes_and_not_the_shard(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "notes"
    folder.write_text("no folder", encoding="utf-8")
    crashes = Crashes("campus", "shard-0", folder)
    with crashes.stepping("cellar", 600):
        pass
    crashes.close()
    assert (crashes.suspects, dict(crashes.guilty)) == ((), {})
    told = [record.getMessage() for record in caplog.records if record.levelno == logging.ERROR]
    assert len(told) == 1
    assert "cannot be found" in told[0]


def test_a_disk_that_fills_up_stops_no_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    crashes = Crashes("campus", "shard-0", tmp_path)
    monkeypatch.setattr(os, "pwrite", _fail)
    stepped = []
    for time in (600, 1200):
        with crashes.stepping("cellar", time):
            stepped.append(time)
    assert stepped == [600, 1200]
    assert len(caplog.records) == 1


def _fail(*arguments: object, **named: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")
