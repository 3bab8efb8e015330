"""Commands as an operator types them, and what comes: a transcript, whose answers `make golden` writes anew.

A block of commands.txt begins with `$` and a command on the configuration of `config_samples`. Below stand the exit
code unless it is 0, the output, and after a `!` each line of complaint. Of `check` and `show-config` with changes that
pass there is only what these change: lines that go with a `-`, lines that come with a `+`.
"""

import contextlib
import difflib
import io
import shlex
from pathlib import Path

import pytest
from support.cases import WRITING
from support.config_samples import sound, write

from service.cli.main import main

FILE = Path(__file__).with_name("commands.txt")
EXAMPLES = Path(__file__).parents[3] / "deploy" / "examples"


def blocks() -> list[str]:
    return FILE.read_text(encoding="utf-8").removeprefix("$ ").removesuffix("\n").split("\n$ ")


def ran(*words: str) -> tuple[int, list[str], list[str]]:
    """Exit code and lines of a command."""
    out, complaints = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(complaints):
        code = main(words)
    return code, out.getvalue().splitlines(), complaints.getvalue().splitlines()


@pytest.mark.parametrize("block", blocks(), ids=lambda block: block.splitlines()[0])
def test_a_command_answers_as_it_is_written(block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tables = sound(tmp_path)
    # The options of a bank are a page, and another one with each choice of its members.
    for zone, estimator in zip(tables["zones"], ("rbpf", "ekf"), strict=True):
        zone["estimator"] = estimator
    write(tmp_path, tables)
    monkeypatch.chdir(tmp_path)
    command = block.splitlines()[0]
    words = shlex.split(command.replace("EXAMPLES", str(EXAMPLES)))
    code, out, complaints = ran(*words)
    if (
        code == 0
        and words[1:] != ["house.toml"]
        and words[:2] in (["check", "house.toml"], ["show-config", "house.toml"])
    ):
        every = difflib.unified_diff(ran(*words[:2])[1], out, n=0, lineterm="")
        out = [line for line in every if not line.startswith(("---", "+++", "@@"))]
    lines = [*([f"[{code}]"] if code else []), *out, *(f"! {line}" for line in complaints)]
    found = "\n".join([command, *lines]).replace(str(tmp_path), "FOLDER").replace(str(EXAMPLES), "EXAMPLES")
    if WRITING:
        now = (found if one == block else one for one in blocks())
        FILE.write_text("".join(f"$ {one}\n" for one in now), encoding="utf-8")
    assert found == block or WRITING
    assert found.replace("\n", "").isprintable()
