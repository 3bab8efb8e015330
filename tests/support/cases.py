"""Cases as data: a configuration that is right, changes that spoil it, and the sentences that then come.

A file of mistakes has one table per case: `set` lists changes as those of --set, `says` the sentences, in which FOLDER
stands for the folder of the configuration. `make golden` writes `says` anew.
"""

import json
import os
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from service.config.load import load
from service.errors import ConfigError

WRITING = os.environ.get("THERMOGATE_GOLDEN") == "write"


def mistakes(*files: Path) -> list[Any]:
    """A parameter for each case in `files`: the file, the name of the case, and the case."""
    return [
        pytest.param(file, name, case, id=f"{file.parents[1].name}-{file.stem}: {name}")
        for file in files
        for name, case in tomllib.loads(file.read_text(encoding="utf-8")).items()
    ]


def written(cases: dict[str, dict[str, Sequence[str]]]) -> str:
    """`cases` as a file of mistakes, a line for each change and sentence."""
    return "\n".join(
        f"[{json.dumps(name)}]\n"
        + "".join(f"{key} = [{', '.join(map(_literal, lines))}]\n" for key, lines in case.items())
        for name, case in cases.items()
    )


def _literal(text: str) -> str:
    return json.dumps(text, ensure_ascii=False) if "'" in text or not text.isprintable() else f"'{text}'"


def problems(path: Path, changes: Sequence[str]) -> list[str]:
    """What is said about the configuration at `path` with `changes`."""
    with pytest.raises(ConfigError) as caught:
        load(path, changes)
    return [problem.replace(str(path.parent.resolve()), "FOLDER") for problem in caught.value.problems]


def check_mistake(path: Path, file: Path, name: str, case: dict[str, Any]) -> None:
    """The changes of `case` in the configuration at `path` are told as it says, in nobody's jargon."""
    found = problems(path, case["set"])
    if WRITING:
        cases = tomllib.loads(file.read_text(encoding="utf-8"))
        cases[name]["says"] = found
        file.write_text(written(cases), encoding="utf-8")
    assert found == case["says"] or WRITING
    for problem in found:
        assert problem.isprintable()
        assert not any(jargon in problem for jargon in ("Input should", "[type=", "something else", "pydantic"))
