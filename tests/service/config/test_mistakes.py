"""Every mistake in a configuration is said in one sentence, with its exact place and a remedy."""

import shutil
from pathlib import Path
from typing import Any

import pytest
from support import cases
from support.config_samples import sound, write

FOLDER = Path(__file__).parent / "cases"

FILES = [path for path in sorted(FOLDER.glob("*.toml")) if path.stem != "house"]


@pytest.mark.parametrize(("file", "name", "case"), cases.mistakes(*FILES))
def test_a_mistake_is_one_sentence_at_its_place(file: Path, name: str, case: dict[str, Any], tmp_path: Path) -> None:
    for path in (FOLDER / "house.toml", FOLDER / "log.csv"):
        shutil.copy(path, tmp_path)
    cases.check_mistake(tmp_path / "house.toml", file, name, case)
    assert len(case["says"]) == 1, "a mistake is not followed by others that it caused"


@pytest.mark.parametrize("table", ["site", "sources", "zones"])
def test_a_table_that_is_left_out_is_asked_for(table: str, tmp_path: Path) -> None:
    tables = sound(tmp_path)
    del tables[table]
    (problem,) = cases.problems(write(tmp_path, tables), ())
    assert problem.startswith(f"{table}: ")


@pytest.mark.parametrize(
    ("content", "gist"),
    [
        (b'[site]\nid = "a\n', ("line 2, column", "not TOML")),
        (b"[site]\nid house\n", ("line 2, column 4", "not TOML", "expected '='")),
        (b"[site", ("the end of the file", "not TOML")),
        (b"[site]\n[site]\n", ("line 2", "not TOML")),
        (b'[site]\nid = "B\xfcro"\n', ("line 2 is not UTF-8", "save the file as UTF-8")),
        (b"a = " + b"9" * 5000, ("not TOML",)),
        (b"", ("is missing",)),
    ],
)
def test_file_that_is_not_toml(content: bytes, gist: tuple[str, ...], tmp_path: Path) -> None:
    path = tmp_path / "house.toml"
    path.write_bytes(content)
    problems = cases.problems(path, ())
    for words in gist:
        assert words in problems[0]
    assert all("\n" not in problem for problem in problems)
