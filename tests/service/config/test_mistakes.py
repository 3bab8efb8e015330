"""Every mistake in a configuration is said in one sentence, with its exact place and a remedy."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from support import cases
from support.config_samples import sound, write
from support.config_spoiling import (
    AIR,
    LIVING,
    NETWORK,
    Change,
    Tables,
    air,
    at,
    inline,
    living,
    log,
    problems_of,
)

from service.config.load import load
from service.errors import ConfigError

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
    (problem,) = problems_of(tmp_path, at(**{table: None}))
    assert problem.startswith(f"{table}: ")


def test_all_mistakes_are_found_at_once(tmp_path: Path) -> None:
    def change(tables: Tables) -> None:
        at(colour=1)(tables)
        at("site", id="A")(tables)
        log(pace="fast")(tables)
        living(period="7min", network="nope")(tables)
        air(unit="furlong", source="elsewhere")(tables)
        at("zones", 1, levels=[2])(tables)
        at("zones", 1, "channels", "T_i", unit="furlong", aggregate="meen")(tables)
        at("zones", 1, "network", fixed=["C_x"])(tables)

    found = problems_of(tmp_path, change)

    bedroom = "zones[1] ('bedroom')"
    assert sorted(problem.split(": ")[0] for problem in found) == sorted(
        [
            "colour",
            "site.id",
            "sources.log.pace",
            f"{LIVING}.period",
            NETWORK,
            f"{AIR}.source",
            f"{bedroom}.levels[0]",
            f"{bedroom}.channels.T_i.aggregate",
            f"{bedroom}.channels.T_i.unit",
            f"{bedroom}.network.fixed[0]",
        ]
    )


def test_several_bad_options_are_each_reported(tmp_path: Path) -> None:
    options = {"particles": 1, "gate_low": 7, "particels": 3, "preset": "paper"}

    found = problems_of(tmp_path, living(estimator_options=options))

    places = {problem.split(": ")[0] for problem in found}
    assert places == {f"{LIVING}.estimator_options.{name}" for name in ("particles", "gate_low", "particels")}


def test_options_that_only_clash_together_are_reported_once(tmp_path: Path) -> None:
    found = problems_of(tmp_path, living(estimator_options={"gate_low": 0.8, "gate_high": 0.7}))

    assert len(found) == 1
    assert "gate_low = 0.8 must be below gate_high = 0.7" in found[0]


def test_every_unreadable_file_is_reported(tmp_path: Path) -> None:
    found = problems_of(tmp_path, log(files=["log.csv", "b.csv", "c.csv.gz"]))

    assert [name in problem for name, problem in zip(("b.csv", "c.csv.gz"), found, strict=True)] == [True, True]


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

    with pytest.raises(ConfigError) as caught:
        load(path)

    for words in gist:
        assert words in caught.value.problems[0]
    assert all("\n" not in problem for problem in caught.value.problems)


@pytest.mark.parametrize(("name", "why"), [("gone.toml", "no such file"), (".", "it is a folder")])
def test_file_that_cannot_be_read(name: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path / name)

    (problem,) = caught.value.problems
    assert problem.startswith(f"{tmp_path / name}: cannot be read ({why}")


@pytest.mark.parametrize("value", [10**400, float("nan"), float("inf"), -5, True, "abc", [], {}])
def test_no_value_of_any_type_gets_past_a_number(value: object, tmp_path: Path) -> None:
    found = problems_of(tmp_path, living(hold_inputs=value))

    assert found[0].startswith(f"{LIVING}.hold_inputs: ")


JUNK: list[object] = [5, -1.5, True, "junk", "", [], ["junk"], [[]], {}, {"junk": {"junk": 1}}, [{}]]


@pytest.mark.parametrize("junk", JUNK, ids=repr)
def test_junk_anywhere_is_refused_in_sentences_or_accepted(junk: object, tmp_path: Path) -> None:
    """No value of a wrong type anywhere escapes as another exception than ConfigError."""
    for change in _everywhere(_explicit(tmp_path), junk):
        tables = _explicit(tmp_path)
        change(tables)
        for problem in _outcome(write(tmp_path, tables)):
            assert ": " in problem
            assert "\n" not in problem


def _explicit(folder: Path) -> Tables:
    """The sound tables with an inline network and some options written out."""
    tables = sound(folder)
    inline()(tables)
    tables["zones"][1]["estimator_options"] = {"preset": "paper", "particles": 100, "coordinates": "log"}
    tables["zones"][1]["network"] |= {"fixed": ["C_h"], "parameters": {"C_i": {"value": 1e6}}, "initial": {"T_e": {}}}
    return tables


def _outcome(path: Path) -> list[str]:
    try:
        load(path)
    except ConfigError as error:
        return error.problems
    return []


def _everywhere(tables: Any, junk: object, keys: tuple[str | int, ...] = ()) -> list[Change]:
    changes: list[Change] = []
    for key, value in tables.items() if isinstance(tables, dict) else enumerate(tables):
        changes.append(_replacing((*keys, key), junk))
        if isinstance(value, dict | list):
            changes += _everywhere(value, junk, (*keys, key))
    return changes


def _replacing(keys: tuple[str | int, ...], junk: object) -> Change:
    def change(tables: Tables) -> None:
        table: Any = tables
        for key in keys[:-1]:
            table = table[key]
        table[keys[-1]] = junk

    return change


def test_control_characters_of_a_file_do_not_reach_the_terminal(tmp_path: Path) -> None:
    (problem,) = problems_of(tmp_path, at("site", id="a\x1b[2J\n\u2028b"))

    assert problem.startswith('site.id: "a\\x1b[2J\\n\\u2028b" cannot be an id')
    assert problem.isprintable()
