"""The configuration has no place for a secret, only for where secrets are; and a misplaced one is not shown."""

import re
from collections.abc import Iterator, Mapping
from copy import deepcopy
from itertools import cycle
from pathlib import Path
from typing import Any

import pytest
from pydantic import SecretBytes, SecretStr
from support.config_samples import sound, write
from support.schemas import models

from adapters.kinds import SOURCE_KINDS
from service.cli.main import main
from service.config.http import HttpConfig
from service.config.site import Config
from service.publish.kinds import SINK_KINDS

SECRET = re.compile(r"password|passphrase|secret|token|credential|private|api_?key|users?_file|keys_file")
PLACE = re.compile(r".*_(file|env)")
MARK = "hush-hush-MARKER"


def test_secrets_are_named_by_their_place() -> None:
    kinds, sinks = SOURCE_KINDS.values(), (kind.table for kind in SINK_KINDS.values())
    found, configured = set(), models(Config, *kinds, *(kind.channel for kind in kinds), *sinks)
    for model in configured:
        for name, field in model.model_fields.items():
            if SECRET.search(name):
                hidden = any(kind in str(field.annotation) for kind in (SecretStr.__name__, SecretBytes.__name__))
                place = PLACE.fullmatch(name) or (name == "private_key" and "Path" in str(field.annotation))
                assert place or hidden, f"{model.__name__}.{name} would hold a secret, which show-config prints"
                found.add(name)
    assert found >= {"password_file", "password_env", "users_file", "private_key", "keys_file"}
    assert HttpConfig in configured


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


@pytest.mark.parametrize("command", ["check", "show-config", "run"])
def test_a_secret_in_the_wrong_place_is_refused_and_not_shown(
    tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    raw = sound(tmp_path) | {"http": {"limits": {}}, "zenoh": {}}
    for place, key in zip(tables(raw), cycle(["password", "api_key", "Token", "client_secret"])):
        spoilt = deepcopy(raw)
        at(spoilt, place)[key] = MARK
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
