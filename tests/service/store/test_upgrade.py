"""State that an earlier version wrote goes on with the same bits."""

from __future__ import annotations

import asyncio
import json
import math
import sqlite3
import tarfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.running_zone import Announced, finished, plumbing
from support.zone_samples import comparable, sample, worker

from adapters.reading import Quality
from service.errors import JournalError
from service.records.sample import Sample
from service.records.update import Disturbance
from service.store.checkpoint import Checkpoint
from service.store.journal import Journal
from service.zone import snapshot
from service.zone.zone import Zone

VERSION_1 = Path(__file__).with_name("state-version-1.tar.gz")
STEPS = 40
SKIPPED = 33
"""What is in it: the last twelve samples are in the journal alone, in its write-ahead log, as after a kill."""


@pytest.fixture
def state(tmp_path: Path) -> Path:
    folder = tmp_path / "state"
    with tarfile.open(VERSION_1) as archive:
        archive.extractall(folder, filter="data")
    return folder


def stored(folder: Path) -> Iterator[Sample]:
    """The samples of a journal of version 1, read without Thermogate."""
    connection = sqlite3.connect(folder / "journal.sqlite3")
    rows = connection.execute("SELECT * FROM samples WHERE skipped IS NULL ORDER BY time").fetchall()
    connection.close()
    for _, time, outputs, inputs, output_quality, input_quality, _ in rows:
        yield Sample(
            time,
            np.frombuffer(outputs, "<f8"),
            np.frombuffer(inputs, "<f8"),
            tuple(map(Quality, output_quality.split(","))),
            tuple(map(Quality, input_quality.split(","))),
        )


def test_samples_and_history_of_version_1_are_read_bit_for_bit(state: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    with tarfile.open(VERSION_1) as archive:
        archive.extractall(copy, filter="data")
    expected = list(stored(copy))
    assert [item.time // 300 for item in expected] == [k for k in range(STEPS) if k != SKIPPED]
    journal = Journal.open(state / "journal.sqlite3")
    for old, new in zip(expected, journal.samples_after("z", None), strict=True):
        assert (old.outputs.tobytes(), old.inputs.tobytes()) == (new.outputs.tobytes(), new.inputs.tobytes())
        assert old._replace(outputs=0, inputs=0) == new._replace(outputs=0, inputs=0)  # type: ignore[arg-type]
    assert [row.time // 300 for row in journal.history("z", None, None, 100)] == list(range(28))
    assert journal.claim("z", "mark")
    assert not journal.claim("z", "other")
    assert journal.append("z", sample(STEPS))
    journal.close()
    again = Journal.open(state / "journal.sqlite3")
    assert len(list(again.samples_after("z", None))) == STEPS
    again.close()


def test_a_zone_goes_on_from_version_1_bit_for_bit(state: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    with tarfile.open(VERSION_1) as archive:
        archive.extractall(copy, filter="data")
    with np.load(max((copy / "checkpoints" / "z").glob("*.npz"))) as parts:
        header = json.loads(parts["header"].tobytes())
        arrays = {name.removeprefix("array."): parts[name] for name in parts.files if name.startswith("array.")}
    assert header["format"] == 1
    alone = worker(particles=50)
    snapshot.restore(alone, Checkpoint(header["fingerprint"], header["step"], arrays, header["meta"]))
    fresh = [sample(k) for k in range(STEPS, STEPS + 20)]
    tail = [item for item in stored(copy) if item.time > header["step"]]
    assert len(tail) == 11
    expected = [comparable(alone.step(item)) for item in [*tail, *fresh]]

    async def scenario() -> list[str]:
        announcer = Announced()
        async with plumbing(state, announcer) as shared:
            zone = Zone("z", "rbpf", "mark", worker(particles=50), shared)
            assert await zone.prepare() == (STEPS - 1) * 300
            running = asyncio.create_task(zone.run())
            await zone.accept(fresh)
            await finished(zone, running)
            restored, *others = [comparable(update) for _, update in announcer.updates]
            assert restored == expected[len(tail) - 1]
            return others

    assert asyncio.run(scenario()) == expected[len(tail) :]


VERSION_2 = Path(__file__).with_name("state-version-2.tar.gz")
"""Samples and history of the same zone, by the last code that wrote schema 2."""


def test_a_journal_of_version_2_keeps_its_rows_and_takes_new_columns(tmp_path: Path) -> None:
    with tarfile.open(VERSION_2) as archive:
        archive.extractall(tmp_path, filter="data")
    path = tmp_path / "journal.sqlite3"
    connection = sqlite3.connect(path)
    assert connection.execute("PRAGMA user_version").fetchone() == (2,)
    before = connection.execute("SELECT * FROM history ORDER BY time").fetchall()
    connection.close()
    journal = Journal.open(path)
    rows = journal.history("z", None, None, 100)
    assert [row.time // 300 for row in rows] == list(range(28)), "none counts as damaged"
    assert [row.y for row in rows] == [row[2] for row in before]
    assert all(np.isnan([row.gain_median, row.setpoint]).all() for row in rows)
    assert len(list(journal.samples_after("z", None))) == STEPS - 1
    assert journal.append("z", sample(STEPS)._replace(setpoint=20.5))
    assert journal.append("z", sample(STEPS + 1))
    known = worker(particles=50).step(sample(STEPS)._replace(setpoint=20.5))
    assert known is not None
    gain = Disturbance((-50.0, 120.0, 300.0), 0.9, ((0.05, 0.06, 0.07),))
    journal.record("z", known._replace(disturbance=gain))
    journal.close()
    again = Journal.open(path)
    *_, sampled, last = again.samples_after("z", None)
    assert (sampled.setpoint, np.isnan(last.setpoint)) == (20.5, True)
    (row,) = again.history("z", STEPS * 300, None, 10)
    assert (row.gain_lower, row.gain_median, row.gain_upper, row.setpoint) == (-50.0, 120.0, 300.0, 20.5)
    again.close()


@pytest.mark.parametrize(("table", "change"), [("history", "gain_median = NULL"), ("samples", "setpoint = 19.0")])
def test_the_new_columns_are_checked(tmp_path: Path, table: str, change: str, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "journal.sqlite3"
    journal = Journal.open(path)
    journal.append("z", sample(0)._replace(setpoint=20.5))
    update = worker(particles=50).step(sample(0))
    assert update is not None
    journal.record("z", update._replace(disturbance=Disturbance((math.nan, 120.0, math.nan), 0.9, ())))
    journal.close()
    connection = sqlite3.connect(path)
    connection.execute(f"UPDATE {table} SET {change}")
    connection.commit()
    connection.close()
    again = Journal.open(path)
    if table == "history":
        assert again.history("z", None, None, 10) == []
        assert again.history_columns("z", 0, 300, 300)[0].tolist() == []
        assert "damaged history row" in caplog.text
    else:
        with pytest.raises(JournalError, match="damaged sample"):
            list(again.samples_after("z", None))
    again.close()
