"""What `check` and `run` say to a daemon that others could reach."""

import pytest
from support.certificates import make_pair
from support.config_samples import sound, write

from service.cli.main import main
from service.daemon import exposure
from service.errors import KeyFileError
from service.web.keys import create_key, revoke_key


def complaints(folder, capsys, command="check", **http):
    """What is said to `http`; nothing if it passes."""
    code = main([command, str(write(folder, sound(folder) | {"http": http}))])
    lines = [line.removeprefix("thermogate: ") for line in capsys.readouterr().err.splitlines()]
    assert (code, bool(lines)) in ((0, False), (2, True))
    return lines


@pytest.mark.parametrize("command", ["check", "run"])
def test_every_way_out_wants_encryption_and_a_key(tmp_path, capsys, command):
    pair = make_pair(tmp_path)
    (line,) = complaints(tmp_path, capsys, command, host="0.0.0.0")
    assert line.startswith('http: listening on "0.0.0.0" lets other machines in, which needs encryption')
    encrypted = {"certificate": pair.certificate.name, "private_key": pair.private_key.name}
    for exposed in ({"host": "0.0.0.0"} | encrypted, {"host": "::", "behind_tls_proxy": True}):
        (line,) = complaints(tmp_path, capsys, command, **exposed)
        assert line.startswith("http: other machines are let in, and there is no valid API key")
        assert "thermogate keys create" in line


def test_with_both_it_passes_until_the_last_key_is_revoked(tmp_path, capsys):
    pair = make_pair(tmp_path)
    keys = tmp_path / "keys.json"
    exposed = {
        "host": "0.0.0.0",
        "certificate": str(pair.certificate),
        "private_key": str(pair.private_key),
        "keys_file": str(keys),
    }
    create_key(keys, "one", "read")
    assert complaints(tmp_path, capsys, **exposed) == []
    assert complaints(tmp_path, capsys, host="::", behind_tls_proxy=True, keys_file=str(keys)) == []
    revoke_key(keys, "one")
    assert len(complaints(tmp_path, capsys, **exposed)) == 1


def test_on_loopback_neither_is_needed_but_what_is_given_must_be_right(tmp_path, capsys):
    assert complaints(tmp_path, capsys) == []
    (tmp_path / "keys.json").write_text("{")
    lines = complaints(tmp_path, capsys, certificate="a.pem", private_key="a.key", keys_file="keys.json")
    assert lines[0].startswith(f"http.certificate: {tmp_path}/a.pem cannot be read")
    assert lines[1].startswith(f"http.keys_file: {tmp_path}/keys.json is not a file of keys")
    assert lines[2:] == ["2 mistakes in the configuration; nothing was started"]


def test_who_cannot_see_the_keys_can_check_what_is_on_loopback(tmp_path, capsys, monkeypatch):
    def closed(path):
        raise KeyFileError(f"the keys in {path} cannot be read (Permission denied)")

    monkeypatch.setattr(exposure, "read_keys", closed)
    monkeypatch.setattr(exposure.os, "access", lambda *_: False)
    assert complaints(tmp_path, capsys) == []
    (line,) = complaints(tmp_path, capsys, behind_tls_proxy=True)
    assert "cannot be read (Permission denied)" in line
