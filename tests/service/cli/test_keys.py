"""`thermogate keys` as an operator uses it."""

import re
from pathlib import Path

import pytest
from support.config_samples import sound, write

from service.cli.main import main
from service.web.keys import KeyRing

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def config(tmp_path: Path) -> Path:
    return write(tmp_path, sound(tmp_path) | {"http": {"keys_file": "secrets/keys.json"}})


def keys(*words: object) -> int:
    return main(["keys", *map(str, words)])


def test_create_prints_the_key_alone_on_stdout(config: Path, capsys: Capture) -> None:
    assert keys("create", config, "grafana", "--scope", "read", "--zone", "living") == 0
    shown = capsys.readouterr()
    assert re.fullmatch(r"tg_[\w-]{43}\n", shown.out), "so that it can be piped into a file"
    assert ("only time" in shown.err, "REST is not read without one" in shown.err) == (True, True)
    assert shown.out.strip() not in shown.err
    key = KeyRing(config.parent / "secrets" / "keys.json", required=False).find(shown.out.strip())
    assert (key.name, key.scope, key.zones) == ("grafana", "read", ("living",))


def test_list_and_revoke(config: Path, capsys: Capture) -> None:
    assert keys("list", config) == 0
    assert capsys.readouterr().out.startswith("no keys in ")
    assert keys("create", config, "mpc", "--scope", "admin", "--expires", "2099-01-31T00:00:00+01:00") == 0
    assert keys("create", config, "old", "--scope", "read", "--expires", "90d") == 0
    shown = capsys.readouterr()
    assert shown.err.count("REST is not read without one") == 1
    secret = shown.out.splitlines()[0]
    assert keys("revoke", config, "old") == 0
    assert "'old' is revoked" in capsys.readouterr().out
    assert keys("list", config) == 0
    listed = capsys.readouterr().out
    assert re.search(r"^mpc +admin +all +\S+Z +2099-01-30T23:00:00Z +active$", listed, re.MULTILINE)
    assert re.search(r"^old +read +all .* revoked$", listed, re.MULTILINE)
    assert secret not in listed
    assert keys("revoke", config, "old") == 1
