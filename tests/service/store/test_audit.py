"""The audit trail: chained lines, whoever writes them."""

import json
import logging
from pathlib import Path

import pytest

from service.daemon.logs import audited
from service.store import audit
from service.store.audit import AUDIT, OLDER, TRAIL, about, broken_links, note


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder whose trail has three lines of a daemon and one of a command."""
    with audited(tmp_path):
        for number in range(3):
            AUDIT.warning("%s was refused %d times", f"key k{number}", number, extra=about("denied", f"key k{number}"))
    note(tmp_path, "key", "key 'one' is created")
    return tmp_path


def lines(folder: Path) -> list[dict[str, str]]:
    return [json.loads(line) for line in (folder / TRAIL).read_text().splitlines()]


def test_daemon_and_commands_write_one_chain(folder: Path) -> None:
    written = lines(folder)
    assert [line["event"] for line in written] == ["denied", "denied", "denied", "key"]
    assert written[1]["who"] == "key k1"
    assert written[1]["message"] == "key k1 was refused 1 times"
    assert written[3]["who"].startswith("account ")
    assert all(line["time"].endswith("Z") for line in written)
    assert broken_links(folder) == (4, [])
    assert (folder / TRAIL).stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("damage", ["change", "remove", "tear"])
def test_what_is_changed_or_removed_later_is_found(folder: Path, damage: str) -> None:
    content = (folder / TRAIL).read_bytes().splitlines(keepends=True)
    content[1] = {"change": content[1].replace(b"key k1", b"key k7"), "remove": b"", "tear": content[1][:40]}[damage]
    (folder / TRAIL).write_bytes(b"".join(content))
    _, problems = broken_links(folder)
    assert problems
    assert "line 2" in problems[0]


def test_a_line_cut_off_by_a_power_failure_takes_no_other_with_it(folder: Path) -> None:
    (folder / TRAIL).write_bytes((folder / TRAIL).read_bytes()[:-30])
    note(folder, "key", "key 'two' is created")
    count, problems = broken_links(folder)
    assert count == 5
    assert [problem.partition("line ")[2][:1] for problem in problems] == ["4"]


def test_a_large_trail_goes_on_in_a_new_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(audit, "LARGEST", (folder / TRAIL).stat().st_size - 1)
    note(folder, "key", "key 'two' is created")
    assert len(lines(folder)) == 1
    assert broken_links(folder) == (5, [])
    (folder / OLDER).write_bytes(b"")
    assert broken_links(folder)[1], "the first line of the new file follows the last one of the older"


def test_a_flood_of_one_event_takes_two_lines_a_minute(tmp_path: Path) -> None:
    with audited(tmp_path):
        for _ in range(1000):
            AUDIT.warning("%s has too much", "key k", extra=about("too-many", "key k"))
    written = lines(tmp_path)
    assert len(written) == 3
    assert written[-1]["message"].startswith("998 more like this were left out")
    assert written[-1]["event"] == "too-many"


def test_a_link_in_place_of_the_trail_is_not_followed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    state, other = tmp_path / "state", tmp_path / "other"
    state.mkdir()
    (state / TRAIL).symlink_to(other)
    with audited(state), caplog.at_level(logging.ERROR):
        AUDIT.info("started", extra=about("started", "daemon"))
    assert not other.exists()
    assert "cannot be written" in caplog.text
