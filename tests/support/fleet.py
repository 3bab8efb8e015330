"""Machines of a Ray cluster as process trees on this machine, and a fleet on them, driven from outside."""

import http.client
import json
import os
import secrets
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from support.harness import ROOT, THERMOGATE, ask
from support.processes import Program, free_port
from support.waiting import PATIENCE, Found, wait_until

RAY = Path(sys.executable).with_name("ray")
ATTEMPTS = 5

_ENVIRONMENT = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_health_check_initial_delay_ms": "1000",
    "RAY_health_check_period_ms": "500",
    "RAY_health_check_timeout_ms": "1000",
    "RAY_health_check_failure_threshold": "3",
    "RAY_prestart_worker_first_driver": "0",
    "RAY_worker_niceness": "0",
    # A machine that Ray gave up must not linger.
    "RAY_gcs_rpc_server_reconnect_timeout_s": "60",
    "RAY_AUTH_MODE": "token",
    "RAY_AUTH_TOKEN": secrets.token_hex(32),
    # Machines on which a sample can be poisoned.
    "PYTHONPATH": f"{ROOT}{os.pathsep}{Path(__file__).with_name('poison')}",
    "PYTHONUNBUFFERED": "1",
}


def environment() -> dict[str, str]:
    return os.environ | _ENVIRONMENT


def tree(pid: int) -> list[int]:
    """A process and all below it, the uppermost first."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with suppress(OSError, ValueError):
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
                children.setdefault(parent, []).append(int(entry.name))
    found = [pid]
    for each in found:
        found += children.get(each, [])
    return found


def until(found: Callable[[], Found], what: str, patience: float = PATIENCE, pause: float = 0.05) -> Found:
    """What `found` returns, once that is true, asked every `pause` s."""
    return wait_until(found, lambda: f"waited {patience:.0f} s in vain for {what}", patience, pause)


class Machine(Program):
    """A node of a Ray cluster: `ray start` and all that it starts."""

    def __init__(self, log: Path, *options: str) -> None:
        command = [RAY, "start", "--block", "--num-cpus=8", "--object-store-memory=83886080", *options]
        super().__init__(command, log, env=environment(), start_new_session=True)
        self.frozen: list[int] = []

    @property
    def ended(self) -> bool:
        """Whether it has given up."""
        return self.process.poll() is not None

    def pids(self) -> list[int]:
        """Every process of the machine."""
        return tree(self.process.pid)

    def signal(self, number: int) -> list[int]:
        """Send a signal to every process of the machine; which ones that were."""
        pids = self.pids()
        for pid in pids:
            with suppress(ProcessLookupError):
                os.kill(pid, number)
        return pids

    def kill(self) -> None:
        """Take the power away."""
        # What was stopped first starts nothing while the others end.
        self.signal(signal.SIGSTOP)
        self.signal(signal.SIGKILL)
        self.process.wait()

    def freeze(self) -> None:
        """Stop every process of the machine."""
        self.frozen = self.signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Let those go on that were frozen."""
        for pid in self.frozen:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)


class Cluster:
    """A head and as many other machines as are wanted; a context manager that leaves no process behind."""

    def __init__(self) -> None:
        # A socket's path must be short.
        self.folder = Path(tempfile.mkdtemp(prefix="tgray-", dir="/tmp"))
        self.address = f"127.0.0.2:{free_port()}"
        self._started = 0
        self._addresses: list[Machine] = []
        self.head = self._machine(
            "--head",
            "--node-ip-address=127.0.0.2",
            f"--port={self.address.rpartition(':')[2]}",
            f"--temp-dir={self.folder}/ray",
            "--include-dashboard=false",
            "--disable-usage-stats",
        )
        self.others: list[Machine] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for machine in (*self.others, self.head):
            machine.kill()
        shutil.rmtree(self.folder, ignore_errors=True)

    def add(self) -> Machine:
        """One machine more."""
        machine = self._machine(f"--address={self.address}", f"--node-ip-address=127.0.0.{3 + len(self._addresses)}")
        self._addresses.append(machine)
        self.others.append(machine)
        return machine

    def kill(self, machine: Machine) -> None:
        """Take a machine away for good."""
        self.others.remove(machine)
        machine.kill()

    def log(self) -> str:
        """What the members have logged last, each process by its file."""
        files = sorted(self.folder.glob("ray/session_latest/logs/worker-*.err"), key=lambda file: file.stat().st_mtime)
        said = []
        for file in files:
            # The other lines are those of Ray, for every task.
            lines = [line for line in file.read_text(errors="replace").splitlines() if not line.startswith(":")]
            said += [file.name, *lines[-20:]] if lines else []
        return "\n".join(said)

    def _machine(self, *options: str) -> Machine:
        """A machine that has started. Ray does not bear two that start at once on one machine, nor always one that
        starts beside a busy one; as a service it would be started again."""
        for _ in range(ATTEMPTS):
            self._started += 1
            machine = Machine(self.folder / f"machine-{self._started}.log", *options)
            until(lambda one=machine: one.ended or "Ray runtime started" in one.log(), "a machine")
            if not machine.ended:
                return machine
        raise AssertionError(f"Ray does not start: {machine.log()}")


class Fleet(Program):
    """`thermogate fleet run` on a cluster."""

    def __init__(self, config: Path, address: str, log: Path) -> None:
        self._config, self._address = config, address
        self._told = log.with_suffix(".status")
        self._watch: Program | None = None
        super().__init__(self._command("run"), log, env=environment())

    def __exit__(self, *_: object) -> None:
        if self._watch is not None:
            self._watch.kill()
        self.kill()

    def status(self) -> dict[str, Any]:
        """What `fleet status` told last, which it does all the time; nothing before the fleet answers."""
        if self._watch is None or self._watch.process.poll() is not None:
            command = [*self._command("status"), "--json", "--every", "0.3"]
            self._watch = Program(command, self._told, env=environment(), start_new_session=True)
        lines = [line for line in self._told.read_text().split("\n")[:-1] if line.startswith("{")]
        return json.loads(lines[-1]) if lines else {"members": [], "moving_zones": 0}

    def members(self, kind: str) -> list[dict[str, Any]]:
        """The members whose names begin so, as far as they are ready."""
        return [each for each in self.status()["members"] if each["name"].startswith(kind) and each["ready"]]

    def urls(self) -> list[str]:
        """Where the gateways serve."""
        return [each["url"] for each in self.members("gateway-")]

    def _command(self, what: str) -> list[str]:
        return [str(THERMOGATE), "fleet", what, str(self._config), "--address", self._address]


def get(url: str, key: str = "", timeout: float = 20) -> tuple[int, Any]:
    """Status and JSON body; 0 where nobody answers."""
    return _asked(url, None, key, timeout)


def post(url: str, key: str, timeout: float = 60) -> tuple[int, Any]:
    """The answer to a request without a body; 0 where nobody answers."""
    return _asked(url, b"", key, timeout)


def post_lines(url: str, lines: str, key: str, timeout: float = 60) -> tuple[int, Any]:
    """The answer to readings in line protocol; 0 where nobody answers."""
    return _asked(url, lines.encode(), key, timeout, Content_Type="text/plain")


def _asked(url: str, content: bytes | None, key: str, timeout: float, **headers: str) -> tuple[int, Any]:
    try:
        return ask(url, content, key, timeout, **headers)
    except (OSError, http.client.HTTPException):
        return 0, None
