"""State that an earlier version wrote goes on with the same bits."""

from __future__ import annotations

import asyncio
import json
import sqlite3
import tarfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.running_zone import Announced, finished, plumbing
from support.zone_samples import comparable, sample, worker

from adapters.reading import Quality
from service.records.sample import Sample
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
