"""The rooms of the house and who may import whom."""

import ast
import json
import re
from functools import cache

import pytest
from support.harness import ROOT

PACKAGES = {
    "estimator": set(),
    "adapters": set(),
    "service": {"estimator", "adapters"},
    "replay": {"estimator", "adapters", "service"},
    "thermogate": {"estimator", "adapters", "service", "replay"},
}
"""Which other packages each one may import."""

LEVELS = json.loads((ROOT / "tests" / "floors.json").read_text(encoding="utf-8"))
"""The rooms of each package, from the top floor down. A room imports only from floors below its own."""

IMPURE = "logging threading asyncio socket tomllib sqlite3 time datetime pathlib os"
"""What the estimator does not import."""

CROWDED = 16
"""Modules that one room may hold: more is a hall, in which nobody finds anything."""


def modules(package):
    found = sorted((ROOT / package).rglob("*.py"))
    assert found
    return found


def dotted(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@cache
def parsed(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path):
    """Every module that the file imports, as its full name; `from a import b` as a.b where that is a module."""
    found = []
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            for alias in node.names:
                name = f"{node.module}.{alias.name}"
                is_module = any((ROOT / name.replace(".", "/")).with_suffix(suffix).exists() for suffix in ("", ".py"))
                found.append(name if is_module else node.module)
    return found


def room_of(name):
    return name.split(".")[1] if "." in name else ""


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_one_way(package):
    for path in modules(package):
        named = {name.split(".")[0] for name in imports(path)}
        wrong = (named & set(PACKAGES)) - PACKAGES[package] - {package}
        assert not wrong, f"{dotted(path)} imports {wrong}"


@pytest.mark.parametrize("package", LEVELS)
def test_rooms_import_only_from_floors_below(package):
    floor = {room: index for index, rooms in enumerate(LEVELS[package]) for room in rooms}
    wrong = []
    for path in modules(package):
        own = room_of(dotted(path))
        assert own == "" or own in floor, f"{dotted(path)} is in no room that is listed here"
        for name in imports(path):
            room = room_of(name)
            if name.split(".")[0] != package or own == room or "" in {own, room}:
                continue
            if floor[room] <= floor[own]:
                wrong.append(f"{dotted(path)} imports {name}")
    assert not wrong


def test_the_http_server_knows_no_route_and_the_estimator_is_mathematics_only():
    for path in modules("service/web/server"):
        wrong = [name for name in imports(path) if name.startswith("service.web.") and ".server" not in name]
        assert not wrong, f"{dotted(path)} imports {wrong}"
    for path in modules("estimator"):
        wrong = {name.split(".")[0] for name in imports(path)} & set(IMPURE.split())
        assert not wrong, f"{dotted(path)} imports {wrong}"


@pytest.mark.parametrize("package", PACKAGES)
def test_every_room_says_what_lives_in_it(package):
    for path in modules(package):
        if path.name == "__init__.py":
            assert ast.get_docstring(parsed(path)), f"{path} has no docstring"
            rooms = len([module for module in path.parent.glob("*.py") if module != path])
            assert rooms <= CROWDED, f"{path.parent} holds {rooms} modules"


@pytest.mark.parametrize("package", LEVELS)
def test_the_map_of_the_architecture_shows_every_room_on_its_floor(package):
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    cells = [cell.strip() for line in page.split("```")[1].splitlines() for cell in line.split("│")]
    drawn = [room for cell in cells for room in re.split(r"\s{2,}", cell)[0].split(", ")]
    # Several packages have a room for their errors, always on the lowest floor.
    levels = [set(rooms) - {"errors", "__main__"} for rooms in LEVELS[package]]
    floors = [(room, index) for index, rooms in enumerate(levels) for room in rooms]
    assert {room for room, _ in floors} <= set(drawn)
    from_above = sorted(floors, key=lambda entry: drawn.index(entry[0]))
    assert [index for _, index in from_above] == sorted(index for _, index in floors)


MOST_ARGUMENTS = 7


def test_every_table_of_cases_belongs_to_a_test():
    for path in ROOT.rglob("tests/**/cases.json"):
        tests = "".join(file.read_text(encoding="utf-8") for file in path.parent.glob("test_*.py"))
        tables = json.loads(path.read_text(encoding="utf-8"))
        assert [name for name in tables if f"def test_{name}(" not in tests] == []


def test_no_constructor_takes_more_arguments_than_can_be_kept_in_mind():
    found = {}
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        for made in (one for one in ast.walk(parsed(path)) if isinstance(one, ast.ClassDef)):
            for function in made.body:
                if isinstance(function, ast.FunctionDef) and function.name == "__init__":
                    arguments = function.args
                    if len([*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]) - 1 > MOST_ARGUMENTS:
                        found[str(path.relative_to(ROOT))] = made.name
    assert not found
