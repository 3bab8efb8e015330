"""The wheel for a plant-room PC: the whole product, and nothing that only a checkout needs."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from configparser import ConfigParser
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from zipfile import ZipFile

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGES = ("estimator", "adapters", "service", "replay", "thermogate")
LEFT_OUT = "replay/lab/"


def builder() -> str | None:
    """Why no wheel can be built here; None if one can."""
    for requirement in map(Requirement, PROJECT["build-system"]["requires"]):
        try:
            found = version(requirement.name)
        except PackageNotFoundError:
            return f"{requirement} is not installed"
        if not requirement.specifier.contains(found):
            return f"{requirement} is needed, and {found} is installed"
    return None


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> ZipFile:
    """The wheel, built offline with the setuptools of this environment from a copy of the sources."""
    if why := builder():
        pytest.skip(f"no wheel can be built: {why}")
    folder = tmp_path_factory.mktemp("wheel")
    # A build in the checkout would leave folders there, and take over stale files from them.
    sources, out = folder / "sources", folder / "out"
    for name in PACKAGES:
        shutil.copytree(ROOT / name, sources / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, sources)
    command = [sys.executable, "-m", "pip", "wheel", "--disable-pip-version-check", "--no-index", "--no-deps"]
    command += ["--no-build-isolation", "--wheel-dir", str(out), str(sources)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (built,) = out.iterdir()
    return ZipFile(built)


def metadata(wheel: ZipFile, file: str) -> str:
    (name,) = (name for name in wheel.namelist() if name.endswith(f".dist-info/{file}"))
    return wheel.read(name).decode()


def test_it_carries_every_module_but_the_laboratory(wheel: ZipFile) -> None:
    modules = {path.relative_to(ROOT).as_posix() for name in PACKAGES for path in (ROOT / name).rglob("*.py")}
    assert any(name.startswith(LEFT_OUT) for name in modules)
    carried = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert {name for name in carried if name.endswith(".py")} == {
        name for name in modules if not name.startswith(LEFT_OUT)
    }
    assert {name.split("/")[0] for name in carried} == set(PACKAGES)


def test_nothing_in_it_imports_what_it_leaves_out(wheel: ZipFile) -> None:
    for name in wheel.namelist():
        if name.endswith(".py"):
            assert not re.search(r"^\s*(from|import) replay\.lab", wheel.read(name).decode(), re.MULTILINE), name


def test_an_experiment_that_only_a_checkout_has_is_refused_in_one_sentence(wheel: ZipFile, tmp_path: Path) -> None:
    wheel.extractall(tmp_path / "installed")
    program = "import sys; from service.cli.main import main; sys.exit(main())"
    for asked in (["cost"], ["hours-ahead"], ["topology"]):
        done = subprocess.run(
            [sys.executable, "-c", program, "experiment", *asked, "--out", str(tmp_path / "out")],
            env=os.environ | {"PYTHONPATH": str(tmp_path / "installed")},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 1, done.stderr
        assert done.stderr.startswith(f"thermogate: experiment {asked[0]}")
        assert "needs a checkout of Thermogate's source; the installed package does not carry it" in done.stderr
        assert done.stderr.count("\n") == 1


def test_it_carries_the_pages(wheel: ZipFile) -> None:
    static = ROOT / "service" / "web" / "static"
    pages = {path.relative_to(ROOT).as_posix(): path for path in static.iterdir()}
    assert "service/web/static/index.html" in pages
    for name, path in pages.items():
        assert wheel.read(name) == path.read_bytes()


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
