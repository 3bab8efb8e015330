"""The real daemon under a service manager of our own: ready, reload, watchdog, stop."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from support.harness import EXAMPLES, ROOT
from support.waiting import wait_until

CONFIG = EXAMPLES / "generic-csv.toml"

# The daemon as it is; where asked for, with one zone whose step never ends, and little patience.
DRIVER = """
import sys, threading
from pathlib import Path
import service.daemon.run, service.daemon.vitals
from service.config.load import load
from service.zone.worker import ZoneWorker

service.daemon.vitals.LOOK_SECONDS = 0.1
if "hang" in sys.argv:
    service.daemon.run.HUNG_SECONDS = 3.0
    service.daemon.vitals.Vitals.__init__.__defaults__ = (3.0,)
    steps = ZoneWorker.step
    def step(self, sample):
        if self.progress.samples == 5:
            threading.Event().wait()
        return steps(self, sample)
    ZoneWorker.step = step
if "break" in sys.argv:
    import service.daemon.runtime
    from service.errors import JournalError

    async def _follow(*_):
        raise JournalError("the journal is gone")

    service.daemon.runtime.Runtime._follow = _follow
overrides = [word for word in sys.argv[2:] if "=" in word]
read = lambda: load(Path(sys.argv[1]), overrides)
sys.exit(service.daemon.run.run_daemon(read(), reread=read))
"""


class Manager:
    """Runs the daemon as systemd does, and hears what it says."""

    def __init__(self, folder: Path, *words: str) -> None:
        self.log = folder / "log"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(folder / "notify"))
        self._socket.settimeout(180)
        environment = {"NOTIFY_SOCKET": str(folder / "notify"), "WATCHDOG_USEC": "2000000"}
        settings = [f"site.state_dir={str(folder / 'state')!r}", "http.port=0", "zenoh.enabled=false"]
        settings += ["zones.room-1.estimator_options.particles=50"]
        with self.log.open("w") as stream:
            self.process = subprocess.Popen(
                [sys.executable, "-c", DRIVER, str(CONFIG), *settings, *words],
                env=os.environ | environment,
                stderr=stream,
                cwd=ROOT,
            )

    def __enter__(self) -> "Manager":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        self._socket.close()

    def hear(self, wanted: str, timeout: float = 240) -> list[str]:
        """Everything up to the message that has `wanted`."""
        heard: list[str] = []
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            assert self.process.poll() is None or wanted == "STOPPING=1", self.log.read_text()
            heard += self._socket.recv(4096).decode().splitlines()
            if wanted in heard:
                return heard
        raise AssertionError(f"{wanted} was not heard in {heard[-20:]}; {self.log.read_text()}")

    def leave(self) -> None:
        """Listen no more."""
        self._socket.close()

    def silence(self, seconds: float) -> bool:
        """Whether nothing is heard for so long."""
        self._socket.settimeout(seconds)
        try:
            self._socket.recv(4096)
        except TimeoutError:
            return True
        finally:
            self._socket.settimeout(180)
        return False


def test_ready_then_fed_then_reloaded_then_stopped(tmp_path: Path) -> None:
    with Manager(tmp_path) as manager:
        before = manager.hear("READY=1")
        assert "WATCHDOG=1" not in before
        assert any(line.startswith("EXTEND_TIMEOUT_USEC=") for line in before)
        # The recording is over soon; a zone that waits for telemetry is no reason to stop.
        for _ in range(40):
            manager.hear("WATCHDOG=1")
        manager.process.send_signal(signal.SIGHUP)
        manager.hear("RELOADING=1")
        manager.hear("READY=1")
        assert "configuration reloaded: nothing has changed" in manager.log.read_text()
        manager.process.send_signal(signal.SIGTERM)
        manager.hear("STOPPING=1")
        assert manager.process.wait(timeout=180) == 0


def test_a_zone_that_hangs_is_not_hidden_by_those_that_work(tmp_path: Path) -> None:
    with Manager(tmp_path, "hang") as manager:
        manager.hear("READY=1")
        wait_until(lambda: "the daemon hangs" in manager.log.read_text())
        wait_until(lambda: manager.silence(1.5), lambda: "the watchdog is fed though a zone hangs")
        wait_until(lambda: "room-1" in manager.log.read_text())
        # systemd then ends it so; the log says where every thread was.
        manager.process.send_signal(signal.SIGABRT)
        assert manager.process.wait(timeout=180) == -signal.SIGABRT
        log = manager.log.read_text()
        assert "Current thread" in log
        assert "threading.py" in log


def test_a_reload_that_breaks_half_way_ends_the_daemon_for_a_fresh_start(tmp_path: Path) -> None:
    with Manager(tmp_path, "break") as manager:
        manager.hear("READY=1")
        manager.process.send_signal(signal.SIGHUP)
        assert manager.process.wait(timeout=180) == 1
        assert "JournalError: the journal is gone" in manager.log.read_text()
