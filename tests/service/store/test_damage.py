"""Damaged and truncated files of every kind: a start heals, or says in one sentence what is wrong; it never lies."""

import asyncio
import logging
import os
import shutil
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from support.running_zone import fed, finished, plumbing
from support.zone_samples import comparable, sample, worker

from service.errors import BackupError, ServiceError
from service.records.history import HistoryRow
from service.store.backup import write_backup
from service.store.verifying import verify
from service.zone.zone import Zone

ITEMS = [sample(k) for k in range(40)]
STRAIGHT = worker(particles=50)
UPDATES = [STRAIGHT.step(item) for item in ITEMS]
BITS = [comparable(update) for update in UPDATES]
ROWS = [repr(HistoryRow.of(update)) for update in UPDATES if update is not None]


def make(shared) -> Zone:  # type: ignore[no-untyped-def]
    return Zone("z", "rbpf", "mark", worker(particles=50), shared)


@pytest.fixture(scope="module")
def crashed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The state folder of a zone that was killed 12 samples after its third checkpoint."""
    live, copy = tmp_path_factory.mktemp("live"), tmp_path_factory.mktemp("crashed") / "state"

    async def scenario() -> None:
        for part in (ITEMS[:10], ITEMS[10:20], ITEMS[20:28]):
            async with plumbing(live) as shared:
                zone = make(shared)
                await finished(zone, await fed(zone, part))
        async with plumbing(live) as shared:
            for item in ITEMS[28:]:
                await shared.store.append("z", item)
            shutil.copytree(live, copy, ignore=shutil.ignore_patterns("*-shm"))

    asyncio.run(scenario())
    return copy


class Outcome(NamedTuple):
    """What a start on damaged files came to."""

    said: bool
    """Whether a sentence, as an error or in the log, tells of it."""
    samples: int | None
    """How many samples the zone has seen whose bits are right; None if it does not run."""


def start(folder: Path, caplog: pytest.LogCaptureFixture) -> Outcome:
    """Start on `folder`. Every number that is there must be one that was there before."""
    caplog.clear()

    async def scenario() -> tuple[int | None, str]:
        async with plumbing(folder) as shared:
            zone = make(shared)
            await zone.prepare()
            status, latest = zone.now().status, zone.now().update
            if status.state == "failed":
                return None, status.reason
            try:
                rows = [repr(row) for row in await zone.history(None, None, 100)]
            except ServiceError as error:
                return None, str(error)
            assert set(rows) <= set(ROWS), "a history row with other numbers"
            if latest is None:
                return 0, ""
            seen = latest.time // 300
            said = bool(warnings(caplog))
            # A zone that had to leave something out learns anew and says so; what it then knows is its own.
            assert comparable(latest) == BITS[seen] or said, f"other numbers at sample {seen}, and no word of it"
            # SQLite does not find the rows behind a key that is damaged; `thermogate verify` does.
            told = said or len(rows) == seen + 1 or verify(folder).problems
            assert told, "history is missing, and no word of it"
            return seen + 1, ""

    try:
        samples, reason = asyncio.run(scenario())
    except ServiceError as error:
        samples, reason = None, str(error)
    said = [reason, *warnings(caplog)] if reason else warnings(caplog)
    assert all("\n" not in sentence and "Traceback" not in sentence for sentence in said), said
    return Outcome(bool(said), samples)


def warnings(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "zeroed": lambda content: bytes(len(content)),
    "random bytes": lambda content: np.random.default_rng(len(content)).bytes(len(content)),
    "empty": lambda content: b"",
    "half": lambda content: content[: len(content) // 2],
    "all but a byte": lambda content: content[:-1],
    "a page zeroed": lambda content: content[:4096] + bytes(min(4096, max(0, len(content) - 4096))) + content[8192:],
}
FILES = {
    "journal": "journal.sqlite3",
    "log": "journal.sqlite3-wal",
    "newest checkpoint": "checkpoints/z/000000008100.npz",
    "middle checkpoint": "checkpoints/z/000000005700.npz",
    "oldest checkpoint": "checkpoints/z/000000002700.npz",
    "lock": "lock",
}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("file", FILES)
def test_a_damaged_file_is_healed_or_told(
    file: str, damage: str, crashed: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "state"
    shutil.copytree(crashed, folder)
    path = folder / FILES[file]
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    outcome = start(folder, caplog)
    if file == "lock" or (file.endswith("checkpoint") and file != "newest checkpoint"):
        assert outcome == (False, 40), "it is not needed"
    elif file == "newest checkpoint":
        assert outcome == (True, 40), "the one before and the journal make it good"
    elif file == "log":
        # What is not there any more is as after an earlier crash; what is there and damaged is told.
        told = f"{path} is damaged, and what was accepted last is lost behind that place" in caplog.text
        assert told or damage in ("empty", "half", "all but a byte")
        assert outcome.samples is not None
        assert outcome.samples >= 28
    else:
        # A page of the journal may be one of which the log has a newer copy.
        assert outcome.said or outcome.samples == 40


@pytest.mark.parametrize("time", [6600, 8100, 8400, 9900, 11700])
def test_a_damaged_key_is_told(time: int, crashed: Path, tmp_path: Path) -> None:
    folder = tmp_path / "state"
    shutil.copytree(crashed, folder)
    # Closing it leaves nothing in the log, whose newer pages would hide the damage.
    sqlite3.connect(folder / FILES["journal"]).execute("PRAGMA wal_checkpoint(TRUNCATE)").connection.close()
    content = bytearray((folder / FILES["journal"]).read_bytes())
    # The row of the history if there is one, else the sample: now of a zone '{', so that searches turn off before it.
    content[content.rindex(b"z" + time.to_bytes(2, "big"))] ^= 1
    (folder / FILES["journal"]).write_bytes(content)
    assert verify(folder).problems
    if time < 8100:
        with pytest.raises(BackupError, match="row not in PRIMARY KEY order"):
            write_backup(folder, "house", tmp_path / "kept.tar")


def test_without_its_journal_a_zone_goes_on_from_its_checkpoint(
    crashed: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    shutil.copytree(crashed / "checkpoints", tmp_path / "state" / "checkpoints")
    assert start(tmp_path / "state", caplog) == (True, 28)
    assert "goes on from its checkpoint at 1970-01-01T02:15:00Z, but the journal ends before any" in caplog.text


def damaged_at(path: Path, stride: int) -> Iterator[int]:
    """Flip one bit of every `stride`-th byte of `path`, one after the other, and put it right again."""
    content = path.read_bytes()
    for offset in range(0, len(content), stride):
        flipped = bytearray(content)
        flipped[offset] ^= 1 << (offset % 8)
        path.write_bytes(flipped)
        yield offset


STRIDES = {"journal": 149, "log": 211} if os.environ.get("FAULTS") == "all" else {"journal": 601, "log": 839}
"""Bytes from one that is tried to the next; fewer are tried here than by `make faults`."""


@pytest.mark.parametrize("file", STRIDES)
def test_a_flipped_bit_never_gives_other_numbers_in_silence(
    file: str, crashed: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    outcomes: Counter[Outcome] = Counter()
    source = tmp_path / "damaged"
    shutil.copytree(crashed, source)
    for offset in damaged_at(source / FILES[file], STRIDES[file]):
        folder = tmp_path / "state"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(source, folder)
        try:
            outcome = start(folder, caplog)
        except Exception as error:
            raise AssertionError(f"a bit flipped in byte {offset} of {file}: {error!r}") from error
        # Where nothing is said nothing is missing either.
        assert outcome.said or outcome.samples == 40, (offset, outcome)
        outcomes[outcome] += 1
    assert any(outcome.said for outcome in outcomes) or file == "log", outcomes
    assert outcomes.total() > 40
