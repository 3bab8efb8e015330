"""Attacks on what the daemon reads and writes, each on a daemon of its own. AssertionError where something gave way."""

from __future__ import annotations

import asyncio
import gzip
import os
import shutil
import signal
import socketserver
import sqlite3
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from pymodbus.constants import ExcCodes
from support.fake_zones import make_sample, make_update
from support.harness import EXAMPLES, THERMOGATE, Daemon, overrides, thermogate
from support.live_modbus import WORDS, configuration, running
from support.modbus_plant import plant
from support.waiting import PATIENCE

from service.store.checkpoint import Checkpoint
from service.store.store import Store

RECORDED = EXAMPLES / "building-67.toml"
ZONE = "building-67"
EXPORT = EXAMPLES / "generic-csv.toml"


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


@contextmanager
def _small_disk(folder: Path, size: str) -> Iterator[Path]:
    """A disk of its own; PermissionError where it cannot be mounted."""
    disk = folder / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "thermogate-attack", str(disk)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        raise PermissionError("mounting a small disk needs root")
    try:
        yield disk
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def damaged_kernel_cache(folder: Path) -> str:
    """Every file of the cache of kernels cut in half."""
    cache = folder / "cache"
    os.environ["NUMBA_CACHE_DIR"] = str(cache)
    try:
        with Daemon(RECORDED, folder / "first.log", _settings(folder)) as daemon:
            before = daemon.wait(lambda zones: zones[ZONE]["samples"] >= 5)[ZONE]["samples"]
            daemon.terminate()
        files = [path for path in cache.rglob("*.nb?") if path.is_file()]
        for path in files:
            os.truncate(path, path.stat().st_size // 2)
        with Daemon(RECORDED, folder / "second.log", _settings(folder)) as daemon:
            # The samples between this look and the stop were learned in the first run.
            daemon.wait(lambda zones: zones[ZONE]["samples"] >= before + 100)
            assert "passes over" not in daemon.log(), daemon.log()
            assert "are damaged" in daemon.log(), daemon.log()
            times = [row["time"] for row in daemon.history(ZONE)]
    finally:
        del os.environ["NUMBA_CACHE_DIR"]
    assert len(times) == len(set(times)) >= before + 100
    return f"{len(files)} files cut, nothing skipped"


def full_kernel_cache(folder: Path) -> str:
    """The cache of kernels on a full disk."""
    with _small_disk(folder, "64k") as disk:
        os.environ["NUMBA_CACHE_DIR"] = str(disk)
        try:
            with Daemon(RECORDED, folder / "log", _settings(folder)) as daemon:
                daemon.wait(lambda zones: zones[ZONE]["samples"] >= 20)
                assert "passes over" not in daemon.log(), daemon.log()
                assert "cannot be kept" in daemon.log(), daemon.log()
        finally:
            del os.environ["NUMBA_CACHE_DIR"]
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


class _Confused(socketserver.BaseRequestHandler):
    """A device that answers every request for registers as if others had been asked for, with 21.5 degC in each."""

    def handle(self) -> None:
        with suppress(OSError):
            while len(request := self.request.recv(12)) == 12:
                transaction, _, _, unit, code, _, count = struct.unpack(">HHHBBHH", request)
                pdu = struct.pack(">BBB", unit, 7 - code, 2 * count) + struct.pack(">H", 215) * count
                self.request.sendall(struct.pack(">HHH", transaction, 0, len(pdu)) + pdu)


def another_function_code(folder: Path) -> str:
    """Answers with another function code than was asked for: registers of another table."""
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), _Confused) as device:
        device.daemon_threads = True
        threading.Thread(target=device.serve_forever).start()
        try:
            path = configuration(folder, {"one": device.server_address[1]})
            with Daemon(path, folder / "log", {"sources.one.timeout": 0.5}) as daemon:
                _until(lambda: "function code" in daemon.log(), "nobody said so")
                channels = daemon.get("/zones/zone-one")[1]["status"]["channels"]
        finally:
            device.shutdown()
    assert all(channel["last_good"] is None for channel in channels), channels
    return "none was taken for a temperature, and the log says so"


def swapped_checkpoints(folder: Path) -> str:
    """The checkpoint of one zone in the folder of another one with the same network."""
    settings = {"site.checkpoint_every": 0.5}
    with running(plant(holding=WORDS)) as site:
        path = configuration(folder, {"one": site.port, "two": site.port})
        with Daemon(path, folder / "first.log", settings) as daemon:
            daemon.wait(lambda zones: all(zone["samples"] >= 5 for zone in zones.values()))
            daemon.terminate()
        others = sorted(folder.rglob("zone-two/*.npz"))
        shutil.copy(others[-1], folder / "state" / "checkpoints" / "zone-one" / "999999999999.npz")
        with Daemon(path, folder / "second.log", settings) as daemon:
            daemon.wait(lambda zones: zones["zone-one"]["state"] == "running")
            assert "it is of zone 'zone-two'" in daemon.log(), daemon.log()
    return "not taken, and said"


def open_folders(folder: Path) -> str:
    """A state folder that every account can look into, and backups."""
    state = folder / "state"
    state.mkdir(mode=0o755)
    state.chmod(0o755)
    with Daemon(RECORDED, folder / "log", _settings(folder)) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 5)
        assert f"say: chmod o= {state}" in daemon.log(), daemon.log()
        options = overrides({"site.state_dir": str(state)})
        done = thermogate("backup", RECORDED, folder / "backup.tar", *options)
        assert done.returncode == 0, done.stderr
    for file in (folder / "backup.tar", state / "lock"):
        assert file.stat().st_mode & 0o077 == 0, file
    return "the folder is warned of; lock and backup are the owner's alone"


def leaping_clock(folder: Path) -> str:
    """Samples of a minute in which the clock was 500 days ahead, after some years; and a zone whose clock was right."""
    day = 86_400

    async def fill() -> None:
        store = Store(folder / "state")
        for zone, last in (("a-leap", 500), ("b-right", 0)):
            times = [hour * 3600 for hour in range(24 * 800)] + [(800 + last) * day + k for k in range(60)]
            for first in range(0, len(times), 1000):
                chunk = [make_sample(0)._replace(time=time) for time in times[first : first + 1000]]
                await asyncio.gather(*(store.append(zone, one) for one in chunk))
                for one in chunk:
                    store.record(zone, make_update(0)._replace(time=one.time))
            store.checkpoints.save(zone, Checkpoint("f", times[-1], {}, {}))
        store.close()

    asyncio.run(fill())
    with Daemon(RECORDED, folder / "log", _settings(folder, 60)) as daemon:
        _until(lambda: "history older than keep_history is deleted" in daemon.log(), "nothing is deleted at all")
        said = daemon.log()
        daemon.terminate()
    with closing(sqlite3.connect(folder / "state" / "journal.sqlite3")) as journal:
        counts = dict(journal.execute("SELECT zone, count(*) FROM samples GROUP BY zone"))
    assert counts["a-leap"] == 24 * 800 + 60, counts
    assert "a-leap" not in said, said
    return f"all {counts['a-leap']} samples are there; of the other zone {24 * 800 + 60 - counts['b-right']} went"


def links_for_root(folder: Path) -> str:
    """Links in the state folder of an account, laid to what only root may read, before root restores and backs up."""
    if os.geteuid() != 0:
        raise PermissionError("only root can be led there")
    secret, state, backup = folder / "secret", folder / "state", folder / "backup.tar"
    secret.write_bytes(b"root's alone")
    secret.chmod(0o600)
    before = secret.stat()
    options = overrides({"site.state_dir": str(state)})
    with Daemon(RECORDED, folder / "log", _settings(folder)) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 5)
        daemon.terminate()
    assert thermogate("backup", RECORDED, backup, *options).returncode == 0
    tried = 0
    for name in ("lock", "configuration.toml", "journal.sqlite3", "restoring.tmp", "keys.json"):
        if (state / name).is_file():
            (state / name).unlink()
        (state / name).symlink_to(secret)
        for path in (state, *state.rglob("*")):
            os.chown(path, 65534, 65534, follow_symlinks=False)
        copy = folder / f"{name}.tar"
        for command in (
            ("restore", RECORDED, backup, "--replace"),
            ("backup", RECORDED, copy),
            ("keys", "create", RECORDED, "one", "--scope", "read"),
        ):
            done = thermogate(*command, *options)
            assert "Traceback" not in done.stderr, done.stderr
            tried += 1
        assert not copy.exists() or b"root's alone" not in copy.read_bytes(), name
        after = secret.stat()
        assert (after.st_uid, after.st_mode, after.st_mtime_ns) == (0, before.st_mode, before.st_mtime_ns), name
        assert secret.read_bytes() == b"root's alone", name
        (state / name).unlink(missing_ok=True)
    return f"{tried} commands of root, and the file is as it was"


def journal_with_a_trigger(folder: Path) -> str:
    """A backup whose journal drops every sample while it acknowledges it."""
    state, backup = folder / "state", folder / "backup.tar"
    options = overrides({"site.state_dir": str(state)})
    with Daemon(RECORDED, folder / "log", _settings(folder)) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 5)
        daemon.terminate()
    with closing(sqlite3.connect(state / "journal.sqlite3")) as journal:
        journal.execute("CREATE TRIGGER silent BEFORE INSERT ON samples BEGIN SELECT RAISE(IGNORE); END")
    assert thermogate("backup", RECORDED, backup, *options).returncode == 0
    restored = thermogate("restore", RECORDED, backup, "--replace", *options)
    assert restored.returncode == 1, restored
    assert "the trigger 'silent'" in restored.stderr, restored.stderr
    with Daemon(RECORDED, folder / "second.log", _settings(folder)) as daemon:
        assert daemon.process.wait(PATIENCE) == 1, daemon.log()
        assert "the trigger 'silent'" in daemon.log(), daemon.log()
    return "neither restored nor opened"


def secrets_in_mistakes(folder: Path) -> str:
    """A private key, and a password, where a path or an address belongs."""
    secret = "THERMOGATE-SECRET"
    pem = f"-----BEGIN PRIVATE KEY-----\n{secret}\n-----END PRIVATE KEY-----\n"
    mistakes: list[dict[str, object]] = [
        {"http.certificate": "c.pem", "http.private_key": pem},
        {"zenoh.connect": [f"tcp/thermogate:{secret}@127.0.0.1:7447"], "zenoh.enabled": True},
    ]
    for mistake in mistakes:
        for command in ("check", "run"):
            done = thermogate(command, RECORDED, *overrides(_settings(folder) | mistake))
            assert done.returncode != 0, done
            assert done.stderr, done
            assert secret not in done.stdout + done.stderr, done
    return f"{2 * len(mistakes)} refusals without it"


def stray_quote(folder: Path) -> str:
    """One quote that is not closed, in the middle of an export."""
    lines = (EXAMPLES / "data" / "generic.csv").read_text(encoding="utf-8").splitlines()
    half = len(lines) // 2
    lines[half] = lines[half].replace(";", ';"', 1)
    spoilt = folder / "spoilt.csv"
    spoilt.write_text("\n".join(lines) + "\n", encoding="utf-8")
    samples = []
    for name, options in (("sound", {}), ("spoilt", {"sources.export.files": [str(spoilt)]})):
        done = thermogate("replay", EXPORT, "--out", folder / name, *overrides(options))
        assert done.returncode == 0, done.stderr
        updates = folder / name / "room-1" / "updates.csv"
        samples.append(updates.read_text().count("\n") - 1)
    assert samples[0] - samples[1] <= 1, samples
    return f"{samples[1]} of {samples[0]} samples"


def line_without_end(folder: Path) -> str:
    """A packed file of 1 MB that is one line of 1 GB."""
    giant = folder / "giant.csv.gz"
    with gzip.open(giant, "wb", compresslevel=1) as file:
        for _ in range(1024):
            file.write(b"x" * 2**20)
    peak, samples = 0, ([], [str(giant)])
    for files in samples:
        options = overrides({"sources.export.files": files} if files else {})
        with (folder / "log").open("w") as log:
            process = subprocess.Popen(
                [str(THERMOGATE), "replay", str(EXPORT), "--out", str(folder / "out"), *options], stdout=log, stderr=log
            )
            _, code, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(code)
        rest, peak = peak, usage.ru_maxrss
    said = (folder / "log").read_text()
    assert process.returncode == 2, said
    assert peak < rest + 50 * 1024, (rest, peak)
    return f"refused: {said.strip().rpartition('giant.csv.gz')[2]}; {(peak - rest) / 1024:+.0f} MB beside a good one"


def journal_cut_off(folder: Path) -> str:
    """A journal of which half is missing."""
    with Daemon(RECORDED, folder / "first.log", _settings(folder)) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 50)
        daemon.terminate()
    journal = folder / "state" / "journal.sqlite3"
    os.truncate(journal, journal.stat().st_size // 2)
    with Daemon(RECORDED, folder / "second.log", _settings(folder)) as daemon:
        assert daemon.process.wait(PATIENCE) == 1, daemon.log()
        (sentence,) = [line for line in daemon.log().splitlines() if line.startswith("thermogate:")]
        assert "if the file itself is damaged, restore a backup" in sentence, sentence
    return "refused at the start, with what to restore"


def start_on_a_full_disk(folder: Path) -> str:
    """A start where there is no space for anything."""
    with _small_disk(folder, "1m") as disk:
        with (disk / "ballast").open("wb", buffering=0) as file:
            for size in (2**16, 2**12, 1):
                try:
                    while True:
                        file.write(bytes(size))
                except OSError:
                    continue
        with Daemon(RECORDED, folder / "log", _settings(disk)) as daemon:
            assert daemon.process.wait(PATIENCE) == 1, daemon.log()
            (sentence,) = [line for line in daemon.log().splitlines() if line.startswith("thermogate:")]
    assert "free space on its disk" in sentence, sentence
    return "refused, with what would free space"


ATTACKS = {
    "4 kernel cache cut in half": damaged_kernel_cache,
    "4 kernel cache on a full disk": full_kernel_cache,
    "6 key file half written": unreadable_keys,
    "7 exception 4 for 2.5 s": passing_failure,
    "8 state folder deleted": deleted_state,
    "9 another function code": another_function_code,
    "10 checkpoint of another zone": swapped_checkpoints,
    "11 folders open to everybody": open_folders,
    "31.3 links for root": links_for_root,
    "31.9 journal with a trigger": journal_with_a_trigger,
    "31.5 clock that leaps ahead": leaping_clock,
    "12 secrets in mistakes": secrets_in_mistakes,
    "14 backup that would fill the disk": made_up_archive,
    "15 a quote that is not closed": stray_quote,
    "15 a line without an end": line_without_end,
    "16 journal cut off": journal_cut_off,
    "18 reload of a pipe": blocked_reload,
    "22 start on a full disk": start_on_a_full_disk,
}
