"""Source archive and wheel for a plant-room PC: the whole product, nothing that only a checkout needs, and it runs."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
from configparser import ConfigParser
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest
from support.harness import PACKAGES, ROOT, ask
from support.processes import Program, fetch
from support.waiting import PATIENCE

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LEFT_OUT = "replay/lab/"


def run(command: list[str], **options: object) -> str:
    """What `command`, which must succeed, prints."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False, **options)  # type: ignore[call-overload]
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(built: tuple[Path, Path]) -> ZipFile:
    return ZipFile(built[1])


def test_the_source_archive_has_what_a_build_needs_and_nothing_else(built: tuple[Path, Path]) -> None:
    with tarfile.open(built[0]) as archive:
        names = [name.split("/", 1)[1] for name in archive.getnames() if "/" in name]
    made = {"PKG-INFO", "setup.cfg", "thermogate.egg-info"}
    assert {name.split("/")[0] for name in names} == made | {
        *PACKAGES,
        "LICENSE",
        "MANIFEST.in",
        "README.md",
        "pyproject.toml",
    }
    assert not any(name.startswith(LEFT_OUT) for name in names)


def metadata(wheel: ZipFile, file: str) -> str:
    (name,) = (name for name in wheel.namelist() if name.endswith(f".dist-info/{file}"))
    return wheel.read(name).decode()


def test_it_carries_every_module_but_the_laboratory_and_the_pages(wheel: ZipFile) -> None:
    modules = {path.relative_to(ROOT).as_posix() for name in PACKAGES for path in (ROOT / name).rglob("*.py")}
    assert any(name.startswith(LEFT_OUT) for name in modules)
    carried = {name for name in wheel.namelist() if ".dist-info/" not in name}
    python = {name for name in carried if name.endswith(".py")}
    assert python == {name for name in modules if not name.startswith(LEFT_OUT)}
    assert {name.split("/")[0] for name in carried} == set(PACKAGES)
    for name in python:
        assert not re.search(r"^\s*(from|import) replay\.lab", wheel.read(name).decode(), re.MULTILINE), name
    pages = {path.relative_to(ROOT).as_posix(): path for path in (ROOT / "service" / "web" / "static").iterdir()}
    assert "service/web/static/index.html" in pages
    assert {name: wheel.read(name) for name in pages} == {name: path.read_bytes() for name, path in pages.items()}
    assert {f"{name}/py.typed" for name in PACKAGES} <= carried, "type checkers read the types of every package"
    assert "replay/bms/learned.tar.xz" in carried, "the demo begins with it"


def test_it_offers_the_commands(wheel: ZipFile) -> None:
    offered = ConfigParser()
    offered.optionxform = str  # type: ignore[assignment, method-assign]
    offered.read_string(metadata(wheel, "entry_points.txt"))
    commands = PROJECT["project"]["entry-points"]["thermogate.commands"]
    assert dict(offered["console_scripts"]) == PROJECT["project"]["scripts"]
    assert dict(offered["thermogate.commands"]) == commands
    for target in commands.values():
        module, _, function = target.partition(":")
        assert f"def {function}(" in wheel.read(f"{module.replace('.', '/')}.py").decode()


def test_it_names_the_version_and_the_licence(wheel: ZipFile) -> None:
    text = metadata(wheel, "METADATA")
    assert f"\nVersion: {PROJECT['project']['version']}\n" in text
    assert "\nLicense-Expression: Apache-2.0\n" in text
    assert metadata(wheel, "licenses/LICENSE") == (ROOT / "LICENSE").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def installed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel: that of `make release`, which has each dependency installed as well, or one that
    borrows them from this environment, which takes a second."""
    if given := os.environ.get("THERMOGATE_INSTALLED"):
        return Path(given)
    _, wheel = request.getfixturevalue("built")
    folder = tmp_path_factory.mktemp("installed")
    run([sys.executable, "-m", "venv", "--without-pip", str(folder)])
    pip = [sys.executable, "-m", "pip", "--python", str(folder / "bin" / "python"), "--disable-pip-version-check"]
    run([*pip, "install", "--no-index", "--no-deps", "--no-compile", str(wheel)])
    (packages,) = folder.glob("lib/python*/site-packages")
    # Python reads no .pth file of a folder that one names: that which leads to the checkout counts for nothing.
    (packages / "borrowed.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder


def outside(installed: Path, folder: Path) -> dict[str, str]:
    """The variables of somebody who has that environment, and neither compiler nor make nor checkout."""
    own = {"PATH": str(installed / "bin"), "HOME": str(folder), "XDG_CACHE_HOME": str(folder / "cache")}
    assert not any(shutil.which(tool, path=own["PATH"]) for tool in ("cc", "gcc", "clang", "make", "git"))
    if "THERMOGATE_INSTALLED" not in os.environ:
        # Compiling every kernel takes a minute.
        own["NUMBA_DISABLE_JIT"] = "1"
    return own


def test_what_is_installed_is_the_wheel(installed: Path, tmp_path: Path) -> None:
    where = outside(installed, tmp_path)
    told = run(["thermogate", "--version"], env=where, cwd=tmp_path)
    assert told == f"thermogate {PROJECT['project']['version']}\n"
    told = run(
        [str(installed / "bin" / "python"), "-c", "import thermogate as tg; print(tg.__file__)"],
        env=where,
        cwd=tmp_path,
    )
    assert Path(told.strip()).is_relative_to(installed)


@pytest.mark.parametrize("name", ["hours-ahead", "topology"])
def test_an_experiment_that_only_a_checkout_has_is_refused_in_one_sentence(
    name: str, installed: Path, tmp_path: Path
) -> None:
    command = ["thermogate", "experiment", name, "--out", str(tmp_path / "out")]
    where = outside(installed, tmp_path)
    done = subprocess.run(command, env=where, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    assert done.stderr.startswith(f"thermogate: experiment {name}")
    assert "needs a checkout of Thermogate's source; the installed package does not carry it" in done.stderr
    assert done.stderr.count("\n") == 1


def test_the_demo_serves_its_page_and_forecasts_and_stops(installed: Path, tmp_path: Path) -> None:
    where = outside(installed, tmp_path)
    command = ["thermogate", "demo", "--port", "0", "--directory", str(tmp_path), "--set", "zenoh.enabled=false"]
    if "NUMBA_DISABLE_JIT" in where:
        # The usual estimator is slow without its compiler.
        for room in range(4):
            command += ["--set", f'zones.{room}.estimator="ekf"']
    with Program(command, tmp_path / "log", env=where, cwd=tmp_path) as daemon:
        # Compiling every kernel first takes minutes on a busy machine.
        url = daemon.says(r"serving on (http://\S+)", 5 * PATIENCE)[1]
        assert "<title>Thermogate" in fetch(url)[1]

        def forecast() -> Any:
            status, body = ask(f"{url}/zones/room1/forecast")
            return body if status == 200 else None

        first = daemon.wait_for(forecast, 5 * PATIENCE)
        assert first["intervals"][0]["lower"] < first["mean"] < first["intervals"][0]["upper"]
        # It lives in its own time, years ago, and nothing is late in it.
        status = ask(f"{url}/zones/room1")[1]["status"]
        assert (status["state"], status["last_sample_time"][:7]) == ("running", "2025-01")
        assert 0 <= status["age_s"] < 86_400
        assert daemon.terminate() == 0
        assert "SYNTHETIC" in daemon.log()
    assert run(["thermogate", "check", "demo.toml"], env=where, cwd=tmp_path)
