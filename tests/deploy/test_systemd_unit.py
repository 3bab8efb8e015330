"""The systemd unit as systemd itself judges it."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "deploy" / "systemd"
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
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@needs_systemd
def test_exposure_is_under_two(tmp_path: Path) -> None:
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


def test_the_daemon_looks_often_enough_and_stops_soon_enough() -> None:
    from service.runtime import DRAIN_SECONDS, SAVE_SECONDS
    from service.vitals import LOOK_SECONDS

    settings = service(UNIT)
    assert float(settings["WatchdogSec"][0].removesuffix("s")) > 4 * LOOK_SECONDS
    assert float(settings["TimeoutStopSec"][0].removesuffix("s")) > 2 * (DRAIN_SECONDS + SAVE_SECONDS)
