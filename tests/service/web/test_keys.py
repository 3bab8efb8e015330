"""API keys in their file, and how a running daemon follows it."""

import errno
import hashlib
import json
import logging
import os
import threading
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from unittest.mock import Mock

import pytest

from service.errors import KeyFileError
from service.web import keys
from service.web.keys import KeyRing, create_key, read_keys, revoke_key


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "state" / "keys.json"


def refused(sentence: str, call: Callable[..., object], *given: object, **named: object) -> None:
    """`call` with what is given to it is refused with `sentence`."""
    with pytest.raises(KeyFileError, match=sentence):
        call(*given, **named)


def test_a_key_has_256_bits_and_its_digest_alone_is_stored(file: Path) -> None:
    secret = create_key(file, "grafana", "read")
    revoke_key(file, "grafana")
    assert [path.name for path in file.parent.iterdir()] == ["keys.json"], "nothing is left beside it"
    assert (secret[:3], len(secret)) == ("tg_", len("tg_") + 43), "256 bits in base64"
    assert secret.removeprefix("tg_") not in file.read_text()
    (stored,) = json.loads(file.read_text())["keys"]
    assert stored["digest"] == hashlib.sha256(secret.encode()).hexdigest()
    assert (stored["name"], stored["scope"], stored["zones"], stored["expires"]) == ("grafana", "read", None, None)
    assert len({create_key(file, f"key-{number}", "read") for number in range(20)}) == 20


def test_a_daemon_follows_keys_that_come_and_go_and_says_so(file: Path, caplog: pytest.LogCaptureFixture) -> None:
    ring = KeyRing(file, required=False)
    assert not ring.in_force
    with caplog.at_level(logging.INFO):
        first, second = create_key(file, "one", "read", ["living"]), create_key(file, "two", "admin")
        found = ring.find(first)
        assert (found.name, found.scope, found.zones) == ("one", "read", ("living",))
        assert ring.find(second) is not None
        assert [ring.find(text) for text in ("tg_nothing", "")] == [None, None]
        for name in ("one", "two"):
            revoke_key(file, name)
        assert [ring.find(secret) for secret in (first, second)] == [None, None]
    assert {record.getMessage() for record in caplog.records} == {
        "API key 'one' with the scope read is in force",
        "API key 'two' with the scope admin is in force",
        "API key 'one' is not in force any more",
        "API key 'two' is not in force any more",
    }
    assert ring.in_force, "revoking the last key does not open the door"
    assert KeyRing(file, required=False).in_force
    file.unlink()
    assert ring.in_force, "nor does a file that goes away"
    assert KeyRing(file, required=True).in_force


def test_an_expired_key_is_not_found(file: Path) -> None:
    now = datetime.now(UTC)
    old = create_key(file, "old", "read", expires=now - timedelta(seconds=1))
    good = create_key(file, "good", "read", expires=now + timedelta(days=1))
    ring = KeyRing(file, required=False)
    assert (ring.find(old), ring.find(good) is None) == (None, False)
    assert [key.state(now) for key in read_keys(file)] == ["expired", "active"]


def test_a_name_is_free_again_once_revoked(file: Path) -> None:
    first, _ = create_key(file, "one", "read"), create_key(file, "other", "read")
    refused("there is a key 'one' already", create_key, file, "one", "admin")
    revoke_key(file, "one")
    for name in ("one", "nobody"):
        refused(f"no key '{name}' to revoke; the keys are other", revoke_key, file, name)
    second = create_key(file, "one", "admin")
    ring = KeyRing(file, required=False)
    assert (ring.find(first), ring.find(second) is None, len(read_keys(file))) == (None, False, 2)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"schema": 2}', b'{"schema": 1, "keys": [{}]}', b"\xff\xfe"])
def test_a_damaged_file_is_refused_at_the_start_and_closes_later(
    file: Path, content: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    secret = create_key(file, "one", "read")
    ring = KeyRing(file, required=False)
    file.write_bytes(content)
    refused("is damaged", KeyRing, file, required=False)
    refused("is damaged", create_key, file, "two", "read")
    assert file.read_bytes() == content, "a file that cannot be read is not overwritten"
    with caplog.at_level(logging.ERROR):
        for _ in range(3):
            refused("cannot be read now", ring.find, secret)
        assert ring.in_force
    assert len(caplog.records) == 1, "and says so once"
    assert "no API key is accepted" in caplog.text


@pytest.mark.parametrize("mode", [0o620, 0o602])
def test_a_file_that_others_can_write_is_not_believed(file: Path, mode: int) -> None:
    secret = create_key(file, "one", "read")
    ring = KeyRing(file, required=False)
    file.chmod(mode)
    refused(r"can be changed by other accounts.*chmod 600", read_keys, file)
    refused("cannot be read now", ring.find, secret)
    file.chmod(0o600)
    assert ring.find(secret) is not None
    if os.geteuid() == 0:
        os.chown(file, 12345, -1)
        refused("can be changed by other accounts", read_keys, file)


@pytest.mark.parametrize("failure", [errno.EMFILE, errno.EACCES, errno.EIO])
def test_a_file_that_cannot_be_read_at_the_moment_closes_and_is_read_later(
    file: Path, monkeypatch: pytest.MonkeyPatch, failure: int
) -> None:
    """With all descriptors in use, the file had been taken for read, and the revoked key stayed good."""
    secret, other = create_key(file, "one", "read"), create_key(file, "two", "read")
    ring = KeyRing(file, required=False)
    key = ring.find(secret)
    assert key is not None
    revoke_key(file, "one")
    with monkeypatch.context() as patched:
        patched.setattr(keys.os, "open", Mock(side_effect=OSError(failure, os.strerror(failure))))
        assert not ring.accepts(key), "a stream ends"
        for asked in (secret, other):
            with pytest.raises(KeyFileError):
                ring.find(asked)
    assert ring.find(secret) is None
    assert ring.find(other) is not None


def test_what_stands_in_the_way_is_said_in_one_sentence(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    refused("cannot be written", create_key, blocked / "keys.json", "one", "read")
    (tmp_path / "keys.json").mkdir()
    refused("is not a file of keys", read_keys, tmp_path / "keys.json")


def test_a_failing_disk_leaves_the_old_file(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    create_key(file, "one", "read")
    before = file.read_bytes()
    monkeypatch.setattr(keys.os, "fsync", Mock(side_effect=OSError(28, "No space left on device")))
    refused("No space left", create_key, file, "two", "read")
    assert file.read_bytes() == before
    assert [path.name for path in file.parent.iterdir()] == ["keys.json"]


def test_writers_do_not_lose_each_others_keys(file: Path) -> None:
    threads = [threading.Thread(target=create_key, args=(file, f"key-{number}", "read")) for number in range(16)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(key.name for key in read_keys(file)) == sorted(f"key-{number}" for number in range(16))


@pytest.mark.parametrize(("mode", "group"), [(0o777, 0), (0o770, 54321)])
def test_a_folder_in_which_others_can_put_another_file_is_not_believed(file: Path, mode: int, group: int) -> None:
    secret = create_key(file, "one", "admin")
    ring = KeyRing(file, required=False)
    if group and os.geteuid() == 0:
        os.chown(file.parent, -1, group)
    elif group:
        pytest.skip("only root can give a folder to a group that it is not in")
    file.parent.chmod(mode)
    refused(r"can be replaced by other accounts.*chmod go-w", read_keys, file)
    os.utime(file)
    refused("cannot be read now", ring.find, secret)
    file.parent.chmod(0o1777)
    assert read_keys(file), "as /tmp is"


def test_a_pipe_or_a_giant_in_the_place_of_the_file_keeps_nobody_waiting(file: Path) -> None:
    file.parent.mkdir(mode=0o700, exist_ok=True)
    os.mkfifo(file)
    refused("is not a file of keys", read_keys, file)
    file.unlink()
    file.touch(0o600)
    os.truncate(file, 10**12)
    refused("is not a file of keys", read_keys, file)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root works for another account")
def test_root_makes_keys_for_the_account_whose_folder_it_is_and_follows_no_link_of_it(tmp_path: Path) -> None:
    folder, private = tmp_path / "state", tmp_path / "private"
    for path in (folder, private):
        path.mkdir(mode=0o700)
    os.chown(folder, 12345, 12345)
    create_key(folder / "keys.json", "one", "read")
    status = (folder / "keys.json").stat()
    assert (status.st_uid, status.st_gid, status.st_mode & 0o777) == (12345, 12345, 0o600)
    assert [key.name for key in read_keys(folder / "keys.json")] == ["one"]
    create_key(private / "keys.json", "private", "admin")
    (folder / "keys.json").unlink()
    (folder / "keys.json").symlink_to(private / "keys.json")
    refused("Permission denied", create_key, folder / "keys.json", "two", "read")
