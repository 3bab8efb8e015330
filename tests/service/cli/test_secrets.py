"""The configuration has no place for a secret, only for where secrets are; and a misplaced one is not shown."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin

import pytest
from pydantic import BaseModel, SecretBytes, SecretStr
from support.config_samples import sound, write

from adapters.kinds import SOURCE_KINDS
from service.cli.main import main
from service.config.http import HttpConfig
from service.config.site import Config

SECRET = re.compile(r"password|passphrase|secret|token|credential|private|api_?key|users?_file|keys_file")
PLACE = re.compile(r".*_(file|env)")
PATHS = {"private_key"}
MARK = "hush-hush-MARKER"


def models(annotation: Any, seen: set[type[BaseModel]]) -> Iterator[type[BaseModel]]:
    """Every model in an annotation, and in the annotations of its fields."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel) and annotation not in seen:
        seen.add(annotation)
        yield annotation
        for field in annotation.model_fields.values():
            yield from models(field.annotation, seen)
    elif get_origin(annotation) in (Union, UnionType) or get_args(annotation):
        for part in get_args(annotation):
            yield from models(part, seen)


def all_models() -> list[type[BaseModel]]:
    seen: set[type[BaseModel]] = set()
    roots = [Config, *SOURCE_KINDS.values(), *(kind.channel for kind in SOURCE_KINDS.values())]
    return [model for root in roots for model in models(root, seen)]


def test_secrets_are_named_by_their_place() -> None:
    found = set()
    for model in all_models():
        for name, field in model.model_fields.items():
            if SECRET.search(name):
                hidden = any(kind in str(field.annotation) for kind in (SecretStr.__name__, SecretBytes.__name__))
                place = PLACE.fullmatch(name) or (name in PATHS and "Path" in str(field.annotation))
                assert place or hidden, f"{model.__name__}.{name} would hold a secret, which show-config prints"
                found.add(name)
    assert found >= {"password_file", "password_env", "users_file", "private_key", "keys_file"}
    assert HttpConfig in all_models()


def tables(raw: Mapping[str, Any], place: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """The place of every table of a configuration."""
    yield place
    for key, value in raw.items():
        for index, item in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if isinstance(item, dict):
                yield from tables(item, (*place, key) if index is None else (*place, key, index))


def at(raw: Any, place: tuple[str | int, ...]) -> Any:
    for part in place:
        raw = raw[part]
    return raw


@pytest.mark.parametrize("key", ["password", "api_key", "Token", "client_secret"])
def test_a_secret_in_the_wrong_place_is_refused_and_not_shown(
    tmp_path: Path, key: str, capsys: pytest.CaptureFixture[str]
) -> None:
    raw = sound(tmp_path) | {"http": {"limits": {}}, "zenoh": {}}
    for place in tables(raw):
        spoilt = tomllib.loads(write(tmp_path, raw).read_text())
        at(spoilt, place)[key] = MARK
        for command in ("check", "show-config", "run"):
            assert main([command, str(write(tmp_path, spoilt)), "--debug"]) != 0, (place, key)
            shown = capsys.readouterr()
            assert MARK not in shown.out + shown.err, (place, key)


@pytest.mark.parametrize("command", ["check", "show-config"])
def test_contents_of_files_are_not_shown(tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("c.pem", "k.pem", "keys.json"):
        (tmp_path / name).write_text(f"{MARK}\n")
    http = {"certificate": "c.pem", "private_key": "k.pem", "keys_file": "keys.json"}
    main([command, str(write(tmp_path, sound(tmp_path) | {"http": http})), "--debug"])
    shown = capsys.readouterr()
    assert "k.pem" in shown.out + shown.err or command == "check"
    assert MARK not in shown.out + shown.err


PEM = f"-----BEGIN PRIVATE KEY-----\n{MARK}\n-----END PRIVATE KEY-----\n"


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize(
    "spoilt",
    [
        {"http": {"certificate": "c.pem", "private_key": PEM}},
        {"http": {"certificate": PEM, "private_key": "k.pem"}},
        {"http": {"host": PEM}},
        {"zenoh": {"connect": [f"tcp/thermogate:{MARK}@127.0.0.1:7447"]}},
        {"zenoh": {"connect": [f"tcp/127.0.0.1:7447#password={MARK}"]}},
        {"zenoh": {"user": "thermogate", "password_file": PEM}},
    ],
)
def test_a_secret_as_a_value_of_another_key_is_not_repeated(
    tmp_path: Path, command: str, spoilt: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, str(write(tmp_path, sound(tmp_path) | spoilt)), "--debug"]) != 0
    shown = capsys.readouterr()
    assert shown.err
    assert MARK not in shown.out + shown.err


def test_escape_sequences_do_not_reach_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    evil = tmp_path / "evil\x1b[2J.npz"
    evil.write_bytes(b"no checkpoint")
    assert main(["inspect", str(evil)]) == 1
    shown = capsys.readouterr()
    assert "damaged" in shown.err
    assert "\x1b" not in shown.out + shown.err
