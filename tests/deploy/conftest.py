"""What these tests share: the project as it is built, an example as a module, and a room that examples ask about."""

import importlib.util
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from packaging.requirements import Requirement
from support.harness import EXAMPLES, PACKAGES, ROOT
from support.http_client import request
from support.site_of_rooms import Room, site_of

from service.records.outlook import Surroundings


def _missing() -> str:
    """Why no wheel can be built here; empty if one can."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for requirement in map(Requirement, project["build-system"]["requires"]):
        try:
            found = version(requirement.name)
        except PackageNotFoundError:
            return f"{requirement} is not installed"
        if not requirement.specifier.contains(found):
            return f"{requirement} is needed, and {found} is installed"
    return ""


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The source archive, and the wheel made from it, built offline with the setuptools of this environment."""
    if why := _missing():
        pytest.skip(f"no wheel can be built: {why}")
    folder = tmp_path_factory.mktemp("wheel")
    # A build in the checkout would leave folders there, and take over stale files from them.
    sources, out = folder / "sources", folder / "out"
    for name in PACKAGES:
        shutil.copytree(ROOT / name, sources / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "MANIFEST.in", "README.md", "LICENSE", "constraints.txt"):
        shutil.copy(ROOT / name, sources)
    shutil.copytree(ROOT / "tests", sources / "tests", ignore=lambda at, names: {n for n in names if n[-3:] != ".py"})
    archive = [sys.executable, "-c", f"from setuptools import build_meta as b; b.build_sdist({str(out)!r})"]
    subprocess.run(archive, cwd=sources, check=True, capture_output=True, timeout=180)
    (source,) = out.iterdir()
    pip = [sys.executable, "-m", "pip", "wheel", "--disable-pip-version-check", "--no-index", "--no-deps"]
    command = [*pip, "--no-build-isolation", "--wheel-dir", out, source]
    subprocess.run(command, check=True, capture_output=True, timeout=180)
    (wheel,) = out.glob("*.whl")
    return source, wheel


@pytest.fixture(scope="module")
def example(request: pytest.FixtureRequest) -> ModuleType:
    """The example that the module of tests names as EXAMPLE."""
    name = request.module.EXAMPLE
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


Asking = Callable[..., Any]


@pytest.fixture(scope="session")
def asking(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Asking]:
    """Makes the examples' `Ask`: of a room "office" that has learned for more than a day, and of one, "new", that has
    just begun. With `trusts`, those by lead are told in place of the trust, of a zone that is `disturbed`."""
    office = Room("ekf", "tite", 480, Surroundings({"u_heat": (0.0, 4000.0)}), 21.0, heated=True)
    with site_of(tmp_path_factory.mktemp("site"), {"office": office, "new": Room("ekf", samples=3)}) as (app, _):

        def make(trusts: dict[int, str] | None = None, disturbed: bool = False) -> Asking:
            def ask(method: str, path: str, body: Any = None) -> Any:
                if trusts is not None and path.endswith("/trust"):
                    told = {"trust": "doubtful", "reason": "so"}
                    horizons = [{"lead_s": lead, "planned": word, **told} for lead, word in trusts.items()]
                    return {"disturbed": disturbed, "horizons": horizons}
                answer = request(app, method, path, **({} if body is None else {"json": body}))
                if answer.status_code >= 400:
                    raise OSError(answer.json()["detail"])
                return answer.json()

            return ask

        yield make
