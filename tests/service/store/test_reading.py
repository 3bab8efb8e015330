"""The state of a folder read while nobody writes it."""

import errno
import os
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from support.fake_zones import make_sample

import service.store.journal
from service.store.journal import Journal
from service.store.reading import stored_fingerprints
from service.store.store import JOURNAL


def test_the_zones_with_samples_are_found_without_reading_the_samples(tmp_path: Path) -> None:
    """Every command that reads a configuration asks for them, and a journal may have gigabytes."""
    with closing(Journal.open(tmp_path / JOURNAL)) as journal:
        for zone in ("living", "empty"):
            journal.claim(zone, f"mark of {zone}")
        journal.append_all([("living", make_sample(step)) for step in range(3)])
    assert stored_fingerprints(tmp_path) == {"living": "mark of living"}
    with closing(sqlite3.connect(tmp_path / JOURNAL)) as connection:
        steps = [row[3] for row in connection.execute(f"EXPLAIN QUERY PLAN {service.store.journal._FINGERPRINTS}")]
    assert not [step for step in steps if "SCAN samples" in step]


def test_a_folder_that_nobody_else_may_look_into_has_no_zones_to_tell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As for an operator who checks a configuration under an account of their own."""
    Journal.open(tmp_path / JOURNAL).close()

    def refuse(path: Path, *, follow_symlinks: bool = True) -> os.stat_result:
        raise OSError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    monkeypatch.setattr(Path, "stat", refuse)
    assert stored_fingerprints(tmp_path) == {}
