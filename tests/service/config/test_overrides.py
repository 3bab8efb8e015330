"""`--set dotted.key=value`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support.config_samples import HEADER, sound, write

from service.config.load import load
from service.config.overrides import apply_overrides
from service.errors import ConfigError


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("a.x=5", 5),
        ("a.x=0.5", 0.5),
        ("a.x=true", True),
        ('a.x="true"', "true"),
        ("a.x=[1, 2]", [1, 2]),
        ("a.x={ y = 1 }", {"y": 1}),
        ("a.x=10min", "10min"),
        ("a.x=titeth", "titeth"),
        ("a.x=/data/log.csv", "/data/log.csv"),
        ("a.x=", ""),
        ("a.x=b=c", "b=c"),
        (" a.x = 5 ", 5),
        ("a.x=1\nz = 2", "1\nz = 2"),
    ],
)
def test_values_are_toml_or_text(override: str, expected: object) -> None:
    assert apply_overrides({"a": {"x": 1}}, [override]) == {"a": {"x": expected}}


def test_list_items_by_index_and_by_id() -> None:
    raw = {"zones": [{"id": "living", "period": 1}, {"id": "1", "period": 2}, {"id": "attic", "levels": [0.5, 0.9]}]}

    changed = apply_overrides(raw, ["zones.0.period=10", "zones.attic.levels.1=0.8", "zones.1.period=20"])

    assert changed["zones"] == [
        {"id": "living", "period": 10},
        {"id": "1", "period": 20},
        {"id": "attic", "levels": [0.5, 0.8]},
    ]


def test_an_id_goes_before_an_index() -> None:
    raw = {"zones": [{"id": "1"}, {"id": "0"}]}

    assert apply_overrides(raw, ["zones.0.period=5"])["zones"][1] == {"id": "0", "period": 5}


def test_missing_tables_are_made_and_quoted_keys_are_one_key() -> None:
    assert apply_overrides({}, ['a."b.c".d=1']) == {"a": {"b.c": {"d": 1}}}


def test_later_overrides_win_and_the_original_stays() -> None:
    raw: dict[str, Any] = {"http": {"port": 1}}

    assert apply_overrides(raw, ["http.port=2", "http.port=3"]) == {"http": {"port": 3}}
    assert raw == {"http": {"port": 1}}


@pytest.mark.parametrize(
    ("override", "gist"),
    [
        ("http.port", 'there is no "="'),
        ("=5", '"" is not a key'),
        ("a..b=5", '"a..b" is not a key'),
        ("a b=5", '"a b" is not a key'),
        ("zones.attic.period=5", 'zones has no item "attic"; its ids are living, bedroom'),
        ("zones.livign.period=5", 'did you mean "living"?'),
        ("zones.7.period=5", 'zones has no item "7"'),
        ("zones.-1.period=5", 'zones has no item "-1"'),
        ("zones.2=5", "its indices go from 0 to 1"),
        ("zones.living.levels.5=0.5", "zones.living.levels has no item"),
        ("site.id.x=5", 'site.id is "house" and has no keys of its own'),
        ("site.id.x.y=5", 'site.id is "house" and has no keys of its own'),
        ("empty.0=5", "empty is an empty list"),
    ],
)
def test_wrong_paths(override: str, gist: str) -> None:
    raw = {
        "site": {"id": "house"},
        "zones": [{"id": "living", "levels": [0.9]}, {"id": "bedroom"}],
        "empty": [],
    }

    with pytest.raises(ConfigError) as caught:
        apply_overrides(raw, [override])

    (problem,) = caught.value.problems
    assert problem.startswith(f"--set {override}: ")
    assert gist in problem


def test_every_wrong_path_is_reported() -> None:
    with pytest.raises(ConfigError) as caught:
        apply_overrides({"a": 1}, ["a.b=1", "c", "a=2"])

    assert [problem.split(":")[0] for problem in caught.value.problems] == ["--set a.b=1", "--set c"]


def test_overrides_are_validated_like_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, sound(tmp_path))

    assert load(path, ["zones.living.period=10min", "http.port=0"]).zones[0].period == 600
    with pytest.raises(ConfigError, match=r"^zones\[1\] \('bedroom'\)\.period: \"7min\" does not divide a day"):
        load(path, ["zones.bedroom.period=7min"])
    with pytest.raises(ConfigError, match=r"^htp: is not a known key"):
        load(path, ["htp.port=1"])


def test_paths_in_overrides_are_relative_to_the_folder_of_the_file_or_absolute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path, sound(tmp_path))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "b.csv").write_text(HEADER, encoding="utf-8")
    monkeypatch.chdir(elsewhere)

    relative = load(path, ['sources.log.files=["log.csv", "elsewhere/b.csv"]'])
    absolute = load(path, [f'sources.log.files=["{elsewhere}/b.csv"]'])

    assert relative.sources["log"].files == (tmp_path / "log.csv", elsewhere / "b.csv")
    assert absolute.sources["log"].files == (elsewhere / "b.csv",)
    with pytest.raises(ConfigError, match="cannot be read"):
        load(path, ['sources.log.files=["b.csv"]'])
