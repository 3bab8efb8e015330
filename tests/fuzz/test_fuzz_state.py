"""State on disk: a checkpoint or a journal with changed bytes is used whole, set aside, or refused in a sentence."""

from __future__ import annotations

import sqlite3
from contextlib import closing

import numpy as np
from fuzz.fuzzing import folder, raw, structured
from hypothesis import strategies as st

from adapters.reading import Quality
from service.errors import JournalError, ServiceError
from service.records.history import HISTORY_COLUMNS
from service.records.sample import Sample
from service.store.checkpoint import Checkpoint, CheckpointStore
from service.store.journal import Journal

FOLDER = folder()
ARRAYS = {"means": np.arange(6.0).reshape(2, 3), "seed": np.array(7), "empty": np.empty((0, 3))}


def written(step: int) -> bytes:
    """The bytes of a small checkpoint."""
    store = CheckpointStore(FOLDER / "good")
    return store.save("z", Checkpoint("mark", step, ARRAYS, {"counters": [1, 2], "text": "é"})).read_bytes()


@raw(written(300), written(600), b"PK\x05\x06" + bytes(18), examples=300)
def test_checkpoint_file(data: bytes) -> None:
    """What is damaged is set aside and the one before it is used; what is whole is what was written."""
    folder = FOLDER / "spoilt" / "z"
    folder.mkdir(parents=True, exist_ok=True)
    for path in folder.iterdir():
        path.unlink()
    (folder / "000000000300.npz").write_bytes(GOOD)
    newest = folder / "000000000600.npz"
    newest.write_bytes(data)
    try:
        loaded = CheckpointStore(FOLDER / "spoilt").load("z", "mark")
    except ServiceError as error:
        # Only a header that is whole can say so.
        assert "newer Thermogate" in str(error) or "belongs to another network" in str(error)
        return
    assert loaded is not None
    assert newest.exists() or newest.with_name(f"{newest.name}.corrupt").exists()
    assert loaded.arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert np.array_equal(loaded.arrays[name], array)


GOOD = written(300)

BLOBS = st.one_of(
    st.binary(max_size=24),
    st.lists(st.floats(width=64), max_size=3).map(lambda values: np.array(values, dtype="<f8").tobytes()),
)
NUMBERS = st.one_of(st.none(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False))
WORDS = st.one_of(st.sampled_from(["good", "good,bad", "uncertain", "", ","]), st.text(max_size=8))


@structured(
    examples=60,
    outputs=BLOBS,
    inputs=BLOBS,
    quality=WORDS,
    history=st.lists(NUMBERS, min_size=19, max_size=19),
)
def test_journal_rows(outputs: bytes, inputs: bytes, quality: str, history: list[float | None]) -> None:
    """Rows that something else wrote are read as samples and history, or refused in a sentence."""
    path = FOLDER / "journal.sqlite3"
    for suffix in ("", "-wal", "-shm"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)
    journal = Journal.open(path)
    journal.append_all([("z", Sample(300, np.array([20.5]), np.array([1.0]), (Quality.GOOD,), (Quality.GOOD,)))])
    with closing(sqlite3.connect(path)) as other, other:
        other.execute("PRAGMA synchronous = OFF")
        rows = {
            "samples": {"outputs": outputs, "inputs": inputs, "output_quality": quality, "input_quality": quality},
            "history": dict(zip(HISTORY_COLUMNS[1:], history, strict=True)),
        }
        for table, row in rows.items():
            values = {"zone": "z", "time": 600} | row
            marks = ", ".join("?" * len(values))
            other.execute(f"INSERT INTO {table} ({', '.join(values)}) VALUES ({marks})", [*values.values()])
    try:
        samples = list(journal.samples_after("z", None))
        assert samples[0].time == 300
        for sample in samples:
            assert sample.outputs.dtype == sample.inputs.dtype == np.float64
        for found in journal.history("z", None, None, 10):
            assert all(isinstance(value, float | int) for value in found)
    except JournalError as error:
        assert str(path) in str(error)
    finally:
        journal.close()


@raw(examples=80)
def test_journal_file(data: bytes) -> None:
    """Bytes written over a journal: it opens and reads, or says what is wrong with which file."""
    path = FOLDER / "whole.sqlite3"
    if not path.exists():
        journal = Journal.open(path)
        for step in range(50):
            row = Sample(300 * step, np.array([20.5]), np.array([1.0]), (Quality.GOOD,), (Quality.GOOD,))
            journal.append_all([("z", row)])
        journal.close()
    spoilt = FOLDER / "spoilt.sqlite3"
    for suffix in ("", "-wal", "-shm"):
        spoilt.with_name(spoilt.name + suffix).unlink(missing_ok=True)
    content = bytearray(path.read_bytes())
    # Two bytes say where, the third how many of the rest replace what was there.
    for at in range(0, len(data) - 3, 8):
        where = int.from_bytes(data[at : at + 2]) % len(content)
        content[where : where + 5] = data[at + 3 : at + 8]
    spoilt.write_bytes(content)
    try:
        with closing(Journal.open(spoilt)) as journal:
            list(journal.samples_after("z", None))
            journal.history("z", None, None, 100)
            journal.append_all(
                [("z", Sample(10**9, np.array([1.0]), np.array([1.0]), (Quality.GOOD,), (Quality.GOOD,)))]
            )
    except JournalError as error:
        assert str(spoilt) in str(error)
