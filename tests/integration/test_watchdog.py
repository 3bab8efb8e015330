"""The real daemon under a service manager of our own: ready, reload, watchdog, stop."""

import os
import signal
import socket
import sys
import time
from pathlib import Path

from support.harness import EXAMPLES, ROOT
from support.processes import Program
from support.waiting import wait_until

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

    follow, reloads = service.daemon.runtime.Runtime._follow, []

    async def _follow(*given):
        reloads.append(given)
        if len(reloads) == 2:
            raise JournalError("the journal is gone")
        await follow(*given)

    service.daemon.runtime.Runtime._follow = _follow
overrides = [word for word in sys.argv[2:] if "=" in word]
read = lambda: load(Path(sys.argv[1]), overrides)
sys.exit(service.daemon.run.run_daemon(read(), reread=read))
"""


class Managed(Program):
    """The daemon, run as systemd does; `hear` is what it says to its service manager."""

    def __init__(self, folder: Path, *words: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(folder / "notify"))
        environment = {"NOTIFY_SOCKET": str(folder / "notify"), "WATCHDOG_USEC": "2000000"}
        settings = [f"site.state_dir={str(folder / 'state')!r}", "http.port=0", "zenoh.enabled=false"]
        settings += ["zones.room-1.estimator_options.particles=50"]
        command = [sys.executable, "-c", DRIVER, EXAMPLES / "generic-csv.toml", *settings, *words]
        super().__init__(command, folder / "log", env=os.environ | environment, cwd=ROOT)

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        self._socket.close()

    def hear(self, wanted: str, seconds: float = 240) -> list[str]:
        """Everything up to the message that has `wanted`."""
        heard: list[str] = []
        deadline = time.monotonic() + seconds
        self._socket.settimeout(180)
        while time.monotonic() < deadline:
            assert self.process.poll() is None or wanted == "STOPPING=1", self.log()
            heard += self._socket.recv(4096).decode().splitlines()
            if wanted in heard:
                return heard
        raise AssertionError(f"{wanted} was not heard in {heard[-20:]}; {self.log()}")

    def is_silent(self, seconds: float) -> bool:
        """Whether nothing is heard for so long."""
        self._socket.settimeout(seconds)
        try:
            self._socket.recv(4096)
        except TimeoutError:
            return True
        return False


def test_ready_then_fed_then_reloaded_and_ended_for_a_fresh_start_by_a_reload_that_breaks(tmp_path: Path) -> None:
    with Managed(tmp_path, "break") as daemon:
        before = daemon.hear("READY=1")
        assert "WATCHDOG=1" not in before
        assert any(line.startswith("EXTEND_TIMEOUT_USEC=") for line in before)
        # The recording is over soon; a zone that waits for telemetry is no reason to stop.
        for _ in range(20):
            daemon.hear("WATCHDOG=1")
        daemon.process.send_signal(signal.SIGHUP)
        daemon.hear("RELOADING=1")
        daemon.hear("READY=1")
        assert "configuration reloaded: nothing has changed" in daemon.log()
        daemon.process.send_signal(signal.SIGHUP)
        daemon.hear("STOPPING=1")
        assert daemon.process.wait(timeout=180) == 1
        assert "JournalError: the journal is gone" in daemon.log()


def test_a_zone_that_hangs_is_not_hidden_by_those_that_work(tmp_path: Path) -> None:
    with Managed(tmp_path, "hang") as daemon:
        daemon.hear("READY=1")
        daemon.says("the daemon hangs")
        wait_until(lambda: daemon.is_silent(1.5), lambda: "the watchdog is fed though a zone hangs")
        daemon.says("room-1")
        # systemd then ends it so; the log says where every thread was.
        assert daemon.terminate(signal.SIGABRT) == -signal.SIGABRT
        assert "Current thread" in daemon.log()
        assert "threading.py" in daemon.log()
