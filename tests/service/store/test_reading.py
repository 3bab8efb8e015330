"""State read beside its owner and left as it is: a folder, and the database of a fleet."""

import errno
import os
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from support.fake_zones import make_sample, make_update
from support.kept import Kept
from support.shards import Shards, checkpoint

from service.errors import Fenced, JournalError, ServiceError
from service.store.journal import _FINGERPRINTS, Journal
from service.store.journalling import JournalStore
from service.store.postgres.reading import read_site
from service.store.reading import read_state, stored_fingerprints
from service.store.store import JOURNAL


async def fill(store: JournalStore) -> None:
    """A zone of two samples and two checkpoints, and one that has none."""
    await store.claim("z", "f")
    for step in (0, 1):
        await store.append("z", make_sample(step))
        store.record("z", make_update(step))
        store.checkpoints.save("z", checkpoint(make_sample(step).time))
    await store.claim("empty", "f")
    await store.run(store.journal.flush)


async def test_it_is_read_as_its_owner_has_written_it_and_left_so(kept: Kept) -> None:
    async with kept.opened("") as store:
        await fill(store)
        kept.damage_checkpoint(make_sample(1).time)
        for _ in range(2):
            with kept.read() as state:
                assert state.journal.fingerprints() == {"z": "f"}
                times = [sample.time for sample in state.journal.samples_after("z", None)]
                assert times == [make_sample(step).time for step in (0, 1)]
                assert state.journal.samples_ahead("z", times[0]) == 1
                assert state.journal.last_sample_time("z") == times[1]
                assert len(state.journal.history("z", None, None, 9)) == 2
                assert state.checkpoint("z", "f").step == times[0], "the damaged one is left out"
                assert state.checkpoint("z", "another") is None
                with pytest.raises((Fenced, JournalError)):
                    state.journal.append_all([("z", make_sample(2))])


def test_what_is_not_there_is_refused_and_not_made(shards: Shards, tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="there is no state of the site 'elsewhere'"):
        read_site(shards.connection, "elsewhere").__enter__()
    assert shards.server.run("SELECT to_regnamespace('thermogate_elsewhere')") == [(None,)]
    with pytest.raises(ServiceError, match="there is no state in"):
        read_state(tmp_path / "elsewhere").__enter__()
    assert stored_fingerprints(tmp_path / "elsewhere") == {}
    assert not (tmp_path / "elsewhere").exists()


def test_the_zones_with_samples_are_found_without_reading_the_samples(tmp_path: Path) -> None:
    """Every command that reads a configuration asks for them, and a journal may have gigabytes."""
    with closing(Journal.open(tmp_path / JOURNAL)) as journal:
        journal.claim("living", "mark")
        journal.append_all([("living", make_sample(0))])
    assert stored_fingerprints(tmp_path) == {"living": "mark"}
    with closing(sqlite3.connect(tmp_path / JOURNAL)) as connection:
        steps = [row[3] for row in connection.execute(f"EXPLAIN QUERY PLAN {_FINGERPRINTS}")]
    assert not [step for step in steps if "SCAN samples" in step]


def test_a_journal_that_is_not_thermogates_is_not_read(tmp_path: Path) -> None:
    Journal.open(tmp_path / JOURNAL).close()
    with closing(sqlite3.connect(tmp_path / JOURNAL)) as connection:
        connection.executescript("DROP TABLE zones; CREATE VIEW zones AS SELECT 1 AS zone, 2 AS fingerprint")
    with pytest.raises(JournalError, match="has the view 'zones', which does not belong into it"):
        read_state(tmp_path).__enter__()


def test_a_folder_that_nobody_else_may_look_into_has_no_zones_to_tell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As for an operator who checks a configuration under an account of their own."""
    Journal.open(tmp_path / JOURNAL).close()

    def refuse(path: Path, *, follow_symlinks: bool = True) -> os.stat_result:
        raise OSError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    monkeypatch.setattr(Path, "stat", refuse)
    assert stored_fingerprints(tmp_path) == {}
