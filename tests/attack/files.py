"""Attacks on what the daemon reads and writes, each on a daemon of its own. AssertionError where something gave way."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from pymodbus.constants import ExcCodes
from support.harness import EXAMPLES, Daemon, thermogate
from support.live_modbus import WORDS, configuration, running
from support.modbus_plant import plant
from support.waiting import PATIENCE

RECORDED = EXAMPLES / "building-67.toml"
ZONE = "building-67"


def _settings(folder: Path, pace: object = 36000) -> dict[str, object]:
    return {
        "site.state_dir": str(folder / "state"),
        "zones.0.estimator_options.particles": 200,
        "sources.simulation.pace": pace,
    }


def _until(done: Callable[[], bool], what: str) -> float:
    """Seconds until `done`; `what` gave way if that does not come at all."""
    begun = time.monotonic()
    while not done():
        assert time.monotonic() - begun < PATIENCE, what
        time.sleep(0.1)
    return time.monotonic() - begun


def damaged_kernel_cache(folder: Path) -> str:
    """Every file of the cache of kernels cut in half."""
    cache = folder / "cache"
    os.environ["NUMBA_CACHE_DIR"] = str(cache)
    try:
        with Daemon(RECORDED, folder / "first.log", _settings(folder)) as daemon:
            daemon.wait(lambda zones: zones[ZONE]["samples"] >= 5)
            daemon.terminate()
        files = [path for path in cache.rglob("*.nb?") if path.is_file()]
        for path in files:
            os.truncate(path, path.stat().st_size // 2)
        with Daemon(RECORDED, folder / "second.log", _settings(folder)) as daemon:
            daemon.wait(lambda zones: zones[ZONE]["samples"] >= 20)
            assert "passes over" not in daemon.log(), daemon.log()
            assert "are damaged" in daemon.log(), daemon.log()
            times = [row["time"] for row in daemon.history(ZONE)]
    finally:
        del os.environ["NUMBA_CACHE_DIR"]
    assert len(times) == len(set(times)) >= 20
    return f"{len(files)} files cut, nothing skipped"


def full_kernel_cache(folder: Path) -> str:
    """The cache of kernels on a full disk."""
    disk = folder / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "thermogate-attack", str(disk)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        return "left out: mounting a small disk needs root"
    os.environ["NUMBA_CACHE_DIR"] = str(disk)
    try:
        with Daemon(RECORDED, folder / "log", _settings(folder)) as daemon:
            daemon.wait(lambda zones: zones[ZONE]["samples"] >= 20)
            assert "passes over" not in daemon.log(), daemon.log()
            assert "cannot be kept" in daemon.log(), daemon.log()
    finally:
        del os.environ["NUMBA_CACHE_DIR"]
        subprocess.run(["umount", str(disk)], check=True)
    return "compiled all the same, nothing skipped"


def unreadable_keys(folder: Path) -> str:
    """A key is revoked by an editor that leaves the file half written."""
    settings = _settings(folder)
    options = [word for key, value in settings.items() for word in ("--set", f'{key}="{value}"')][:2]
    made = thermogate("keys", "create", RECORDED, "one", "--scope", "read", *options)
    assert made.returncode == 0, made.stderr
    secret, file = made.stdout.strip(), folder / "state" / "keys.json"
    with Daemon(RECORDED, folder / "log", settings) as daemon:
        command = ["curl", "-s", "-o", "/dev/null", "-w", "%{http_code}", "-H", f"Authorization: Bearer {secret}"]

        def status() -> str:
            return subprocess.run(
                [*command, f"{daemon.url()}/zones"], capture_output=True, text=True, check=True
            ).stdout

        before = status()
        file.write_bytes(file.read_bytes()[:-30])
        during = status()
    assert (before, during) == ("200", "503")
    return f"{before} before, {during} while nobody can say"


def passing_failure(folder: Path) -> str:
    """Modbus exception 4 for 2.5 s."""
    with running(plant(holding=WORDS)) as site:
        path = configuration(folder, {"one": site.port})
        with Daemon(path, folder / "log", {}) as daemon:
            daemon.wait(lambda zones: zones["zone-one"]["state"] == "running")
            site.exceptions[1] = ExcCodes.DEVICE_FAILURE
            time.sleep(2.5)
            site.exceptions.clear()

            def is_read() -> bool:
                channels = daemon.get("/zones/zone-one")[1]["status"]["channels"]
                return all(channel["age_s"] is not None and channel["age_s"] < 2 for channel in channels)

            seconds = _until(is_read, "the zone stays blind")
    return f"read again after {seconds:.1f} s"


def deleted_state(folder: Path) -> str:
    """The state folder deleted under a running daemon."""
    with running(plant(holding=WORDS)) as site:
        path = configuration(folder, {"one": site.port})
        with Daemon(path, folder / "log", {}) as daemon:
            daemon.wait(lambda zones: zones["zone-one"]["state"] == "running")
            shutil.rmtree(folder / "state")
            seconds = _until(lambda: daemon.get("/healthz")[0] == 503, "nobody noticed")
            assert "has been deleted or replaced" in daemon.log(), daemon.log()
            _until(lambda: daemon.get("/zones")[1]["zones"][0]["state"] == "failed", "samples are acknowledged")
            daemon.terminate()
    return f"noticed after {seconds:.1f} s; nothing is accepted"


def blocked_reload(folder: Path) -> str:
    """A configuration that has become a pipe, a reload, and then a stop."""
    config = folder / "site.toml"
    config.write_text(RECORDED.read_text().replace('files = ["data/', f'files = ["{EXAMPLES}/data/'))
    with Daemon(config, folder / "log", _settings(folder, 60)) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 2)
        config.unlink()
        os.mkfifo(config)
        daemon.process.send_signal(signal.SIGHUP)
        time.sleep(1)
        begun = time.monotonic()
        daemon.process.send_signal(signal.SIGTERM)
        code = daemon.process.wait(timeout=60)
    assert code == 0, code
    return f"stopped after {time.monotonic() - begun:.1f} s"


def made_up_archive(folder: Path) -> str:
    """A sparse tar that would become 20 GB."""
    config = RECORDED
    holes = folder / "journal.sqlite3"
    with holes.open("wb") as file:
        file.truncate(20 * 10**9)
    manifest = (
        '{"format":1,"site":"semi-synthetic","made":"2025-01-01T00:00:00+00:00","files":{"journal.sqlite3":'
        '{"size":20000000000,"sha256":"00"}}}'
    )
    (folder / "manifest.json").write_text(manifest)
    tar = ["tar", "--sparse", "-cf", str(folder / "evil.tar"), "-C", str(folder), "manifest.json", "journal.sqlite3"]
    subprocess.run(tar, check=True)
    state = folder / "state"
    done = thermogate("restore", config, folder / "evil.tar", "--set", f'site.state_dir="{state}"')
    assert done.returncode == 1, done
    assert done.stderr.count("\n") == 1, done.stderr
    written = sum(path.stat().st_blocks * 512 for path in state.rglob("*")) if state.exists() else 0
    assert written < 2**20, written
    return done.stderr.strip().rpartition(": ")[2]


ATTACKS = {
    "4 kernel cache cut in half": damaged_kernel_cache,
    "4 kernel cache on a full disk": full_kernel_cache,
    "6 key file half written": unreadable_keys,
    "7 exception 4 for 2.5 s": passing_failure,
    "8 state folder deleted": deleted_state,
    "14 backup that would fill the disk": made_up_archive,
    "18 reload of a pipe": blocked_reload,
}
