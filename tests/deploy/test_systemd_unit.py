"""The systemd unit as systemd itself judges it."""

import os
import re
import shutil
import subprocess
import sys
from ctypes.util import find_library
from pathlib import Path

import pytest
from support.harness import EXAMPLES, ROOT, THERMOGATE, overrides
from support.processes import Program, free_port

from service.daemon.runtime import DRAIN_SECONDS, SAVE_SECONDS
from service.daemon.vitals import LOOK_SECONDS

FOLDER = ROOT / "deploy" / "systemd"
UNIT = FOLDER / "thermogate.service"
EXPOSURE = 2.0

needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed here"
)


def service(path: Path) -> dict[str, list[str]]:
    """The settings of [Service]; one that is given several times has several values."""
    found: dict[str, list[str]] = {}
    for line in path.read_text(encoding="utf-8").partition("[Service]")[2].partition("[Install]")[0].splitlines():
        if line and not line.startswith("#"):
            key, _, value = line.partition("=")
            found.setdefault(key, []).append(value)
    return found


def analyze(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = ["systemd-analyze", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)


@needs_systemd
def test_exposure_is_under_two() -> None:
    done = analyze("security", "--offline=true", "--no-pager", UNIT)
    found = re.search(r"Overall exposure level for thermogate.service: ([\d.]+)", done.stdout)
    assert found, done.stdout + done.stderr
    assert float(found[1]) < EXPOSURE, done.stdout


@needs_systemd
@pytest.mark.parametrize("example", [None, *sorted((FOLDER / "thermogate.service.d").glob("*.example"))], ids=str)
def test_systemd_finds_nothing_wrong(tmp_path: Path, example: Path | None) -> None:
    text = UNIT.read_text(encoding="utf-8")
    if example is not None:
        text = text.replace("[Install]", example.read_text(encoding="utf-8").partition("[Service]")[2] + "\n[Install]")
    unit = tmp_path / "thermogate.service"
    # Only the place of the program is this machine's.
    unit.write_text(text.replace("/opt/thermogate/bin/thermogate", sys.executable), encoding="utf-8")
    done = analyze("verify", unit)
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


def test_it_is_what_the_daemon_expects() -> None:
    settings = service(UNIT)
    assert settings["Type"] == ["notify"]
    assert settings["ExecReload"] == ["/bin/kill -HUP $MAINPID"]
    # The kernels are cached in $XDG_CACHE_HOME/thermogate, which has to be a folder that the unit makes.
    assert "XDG_CACHE_HOME=%C" in settings["Environment"][0].split()
    assert settings["CacheDirectory"] == ["thermogate"]
    assert "%S/thermogate" in settings["ExecStart"][0]
    assert settings["StateDirectory"] == ["thermogate"]
    assert settings["DynamicUser"] == ["yes"]
    assert settings["IPAddressDeny"] == ["any"]
    # Numba cannot do without, and the unit says so.
    assert settings["MemoryDenyWriteExecute"] == ["no"]
    assert "Numba compiles" in UNIT.read_text(encoding="utf-8")

    # It looks often enough and stops soon enough.
    assert float(settings["WatchdogSec"][0].removesuffix("s")) > 4 * LOOK_SECONDS
    assert float(settings["TimeoutStopSec"][0].removesuffix("s")) > 2 * (DRAIN_SECONDS + SAVE_SECONDS)


def allowed_calls() -> set[str]:
    """What the unit's SystemCallFilter leaves, its groups resolved by systemd itself."""
    groups: dict[str, list[str]] = {}
    for line in analyze("syscall-filter", "--no-pager").stdout.splitlines():
        if line.startswith("@"):
            members = groups[line.strip()] = []
        elif line.strip() and not line.strip().startswith("#"):
            members.append(line.strip())

    def resolved(name: str) -> set[str]:
        return set().union(*map(resolved, groups[name])) if name.startswith("@") else {name}

    calls: set[str] = set()
    for value in service(UNIT)["SystemCallFilter"]:
        named = set().union(*map(resolved, value.removeprefix("~").split()))
        calls = calls - named if value.startswith("~") else calls | named
    return calls


# Runs a program with these system calls alone; any other fails with EPERM, as the unit has it.
FILTERED = """
import ctypes, errno, os, sys
library = ctypes.CDLL("libseccomp.so.2")
library.seccomp_init.restype = ctypes.c_void_p
context = ctypes.c_void_p(library.seccomp_init(ctypes.c_uint32(0x00050000 | errno.EPERM)))
for name in sys.argv[1].split(","):
    number = library.seccomp_syscall_resolve_name(name.encode())
    if number >= 0:
        library.seccomp_rule_add(context, ctypes.c_uint32(0x7FFF0000), number, 0)
assert library.seccomp_load(context) == 0
os.execv(sys.argv[2], sys.argv[2:])
"""


# Compiles a kernel and keeps it.
COMPILING = """
from service.daemon.process import prepare_process
prepare_process()
from estimator.kernels.draws import Draws, Purpose
Draws(1, 0).normals(Purpose(0), (2, 32))
"""


def filtered(calls: set[str], *command: object) -> list[str]:
    return [sys.executable, "-c", FILTERED, ",".join(sorted(calls)), *map(str, command)]


@needs_systemd
@pytest.mark.skipif(find_library("seccomp") is None, reason="libseccomp is not installed here")
def test_the_daemon_gets_on_with_the_system_calls_that_it_is_left(tmp_path: Path) -> None:
    calls = allowed_calls()
    assert {"execve", "mmap", "setpriority"} <= calls
    assert not {"ptrace", "mount", "chown", "sched_setscheduler", "bpf"} & calls
    denied = filtered(calls, sys.executable, "-c", "import os; os.chown('/tmp', 0, 0)")
    refused = subprocess.run(denied, capture_output=True, text=True, timeout=180, check=False)
    assert "PermissionError" in refused.stderr, "the filter is in force"
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop("NUMBA_CACHE_DIR", None)
    compiled = subprocess.run(filtered(calls, sys.executable, "-c", COMPILING), env=environment, cwd=ROOT, check=False)
    assert compiled.returncode == 0
    assert list(tmp_path.rglob("cache/thermogate/**/*.nbc")), "the kernel was compiled here"
    # Samples learned with kernels that are there, checkpoints written, REST and Zenoh served, all under the filter.
    settings = {"site.state_dir": str(tmp_path / "state"), "zones.room-1.estimator": "ekf"}
    settings |= {"http.port": 0, "zenoh.listen": [f"tcp/127.0.0.1:{free_port()}"]}
    command = filtered(calls, THERMOGATE, "run", EXAMPLES / "generic-csv.toml", *overrides(settings))
    with Program(command, tmp_path / "log") as daemon:
        daemon.says("come to its end", 600)
        assert daemon.terminate() == 0, daemon.log()
    assert "serving on" in daemon.log()
    assert "ERROR" not in daemon.log()
    assert list(tmp_path.rglob("checkpoints/room-1/*.npz")), daemon.log()
