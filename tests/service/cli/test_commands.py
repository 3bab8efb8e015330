"""Commands as an operator types them, and what comes: a transcript, whose answers `make golden` writes anew.

A block of commands.txt begins with `$` and a command on the configuration of `config_samples`. Below stand the exit
code unless it is 0, the output, and after a `!` each line of complaint. Of `check` and `show-config` with changes that
pass there is only what these change: lines that go with a `-`, lines that come with a `+`.
"""

from __future__ import annotations

import contextlib
import difflib
import io
import shlex
from functools import cache
from pathlib import Path

import pytest
from support.cases import WRITING
from support.config_samples import sound, write
from support.harness import EXAMPLES

from service.cli.main import main

FILE = Path(__file__).with_name("commands.txt")


def blocks() -> list[str]:
    return FILE.read_text(encoding="utf-8").removeprefix("$ ").removesuffix("\n").split("\n$ ")


def ran(*words: str) -> tuple[int, list[str], list[str]]:
    """Exit code and lines of a command."""
    out, complaints = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(complaints):
        code = main(words)
    return code, out.getvalue().splitlines(), complaints.getvalue().splitlines()


usual = cache(ran)
"""The same of a command that says the same each time."""


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with house.toml. No command here writes into it."""
    folder = tmp_path_factory.mktemp("house")
    tables = sound(folder)
    # The options of a bank are a page, and another one with each choice of its members.
    for zone, estimator in zip(tables["zones"], ("rbpf", "ekf"), strict=True):
        zone["estimator"] = estimator
    write(folder, tables)
    return folder


@pytest.mark.parametrize("block", blocks(), ids=lambda block: block.splitlines()[0])
def test_a_command_answers_as_it_is_written(block: str, house: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(house)
    command = block.splitlines()[0]
    words = shlex.split(command.replace("EXAMPLES", str(EXAMPLES)))
    code, out, complaints = ran(*words)
    if code == 0 and len(words) > 2 and words[:2] in (["check", "house.toml"], ["show-config", "house.toml"]):
        every = difflib.unified_diff(usual(*words[:2])[1], out, n=0, lineterm="")
        out = [line for line in every if not line.startswith(("---", "+++", "@@"))]
    lines = [*([f"[{code}]"] if code else []), *out, *(f"! {line}" for line in complaints)]
    found = "\n".join([command, *lines]).replace(str(house), "FOLDER").replace(str(EXAMPLES), "EXAMPLES")
    if WRITING:
        now = (found if one == block else one for one in blocks())
        FILE.write_text("".join(f"$ {one}\n" for one in now), encoding="utf-8")
    assert found == block or WRITING
    assert found.replace("\n", "").isprintable()
