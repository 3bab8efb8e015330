"""The rooms of the house and who may import whom."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("estimator", "adapters", "service", "replay")
MAY_IMPORT = {
    "estimator": set(),
    "adapters": set(),
    "service": {"estimator", "adapters"},
    "replay": {"estimator", "service"},
}
MATHEMATICS_ONLY = {
    "logging",
    "threading",
    "asyncio",
    "socket",
    "tomllib",
    "sqlite3",
    "time",
    "datetime",
    "pathlib",
    "os",
}


def imports(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.split(".")[0]


def modules(package):
    found = sorted((ROOT / package).rglob("*.py"))
    assert found
    return found


@pytest.mark.parametrize("package", PACKAGES)
def test_arrows_point_one_way(package):
    for path in modules(package):
        name = str(path.relative_to(ROOT))
        allowed = MAY_IMPORT[package] | {package} | ({"replay"} if name.startswith("service/cli") else set())
        wrong = (set(imports(path)) & set(PACKAGES)) - allowed
        assert not wrong, f"{name} imports {wrong}"


def test_the_estimator_is_mathematics_only():
    for path in modules("estimator"):
        wrong = set(imports(path)) & MATHEMATICS_ONLY
        assert not wrong, f"{path.name} imports {wrong}"


@pytest.mark.parametrize("package", PACKAGES)
def test_files_have_one_reason_to_exist(package):
    for path in modules(package):
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 400, path
