"""The pinned dependencies: each is needed by somebody, and the audit tells a finding from a database that is away."""

import json
import re
import sys
import tomllib
from importlib.machinery import SourceFileLoader
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from support.tables import tabled

ROOT = Path(__file__).parents[1]
PINS = {
    canonicalize_name(name): version
    for name, version in re.findall(r"^([\w.-]+)==(\S+)$", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
}


def wanted(extra: str | None = None) -> list[Requirement]:
    """What the project needs with `extra`; None: with all of them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    optional = project["optional-dependencies"]
    chosen = optional.keys() if extra is None else {extra, *Requirement(optional[extra][0]).extras}
    extras = [line for name in chosen for line in optional[name]]
    found = [Requirement(line) for line in project["dependencies"] + extras]
    return [one for one in found if one.name != project["name"]]


def closure(extra: str | None = None) -> tuple[set[str], set[str]]:
    """Everything that the project needs with `extra`, or with all, as far as it is installed; and what is not."""
    needed, missing, queue = set(), set(), [(one, frozenset(one.extras)) for one in wanted(extra)]
    seen = set()
    while queue:
        requirement, extras = queue.pop()
        name = canonicalize_name(requirement.name)
        if (name, extras) in seen:
            continue
        seen.add((name, extras))
        needed.add(name)
        try:
            lines = requires(name) or []
        except PackageNotFoundError:
            missing.add(name)
            continue
        for inner in map(Requirement, lines):
            chosen = [{"extra": extra} for extra in extras or {""}]
            if inner.marker is None or any(inner.marker.evaluate(environment) for environment in chosen):
                queue.append((inner, frozenset(inner.extras)))
    return needed, missing


def test_everything_that_is_needed_is_pinned() -> None:
    needed, missing = closure()
    assert needed - missing <= PINS.keys(), "pin it in constraints.txt"


def test_nothing_is_pinned_that_nobody_needs() -> None:
    needed, missing = closure()
    if missing:
        pytest.skip(f"what these need is not known here: {', '.join(sorted(missing))}")
    assert PINS.keys() <= needed, "remove it from constraints.txt"


@pytest.mark.parametrize("requirement", wanted(), ids=str)
def test_the_pin_is_within_the_range(requirement: Requirement) -> None:
    assert requirement.specifier.contains(PINS[canonicalize_name(requirement.name)])


def test_the_lock_has_the_pins_of_what_a_site_can_use_and_the_hashes_of_their_files() -> None:
    lines = (ROOT / "requirements.lock").read_text().replace("\\\n", "").splitlines()
    locked = {}
    for line in lines:
        name, version = re.fullmatch(r"([\w.-]+)==(\S+)(?:\s+--hash=sha256:[0-9a-f]{64})+", line).groups()  # type: ignore[union-attr]
        locked[canonicalize_name(name)] = version
    assert locked.items() <= PINS.items(), "make lock"
    needed, missing = closure("all")
    assert needed - missing <= locked.keys(), "make lock"


@tabled
def test_the_audit_tells_a_finding_from_silence(
    found: list | None, code: int, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    """With a stand-in for pip-audit that reports `found`, or nothing but an error."""
    loader = SourceFileLoader("audit", str(ROOT / ".ci" / "audit"))
    spec = spec_from_loader("audit", loader)
    assert spec is not None
    audit = module_from_spec(spec)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    loader.exec_module(audit)
    monkeypatch.setattr(audit, "ROOT", tmp_path)
    stand_in = tmp_path / "var" / "audit-venv" / "bin" / "pip-audit"
    stand_in.parent.mkdir(parents=True)
    write = f"open(path, 'w').write({json.dumps(json.dumps({'dependencies': found}))})" if found is not None else ""
    stand_in.write_text(
        f"#!{sys.executable}\nimport sys\npath = sys.argv[-1].split('=')[1]\n{write}\n"
        "print('no route to host', file=sys.stderr)\nsys.exit(1)\n"
    )
    stand_in.chmod(0o755)
    assert audit.main(str(ROOT / "constraints.txt")) == code
    said = capsys.readouterr()
    assert says in said.out + said.err
