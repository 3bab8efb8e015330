"""State on disk: rows of a journal that something else wrote are read, or refused in a sentence."""

import sqlite3
from contextlib import closing

import numpy as np
from fuzz.fuzzing import folder, structured
from hypothesis import strategies as st

from adapters.reading import Quality
from service.errors import JournalError
from service.records.history import HISTORY_COLUMNS
from service.records.sample import Sample
from service.store.journal import Journal

FOLDER = folder()


BLOBS = st.one_of(
    st.binary(max_size=24),
    st.lists(st.floats(width=64), max_size=3).map(lambda values: np.array(values, dtype="<f8").tobytes()),
)
NUMBERS = st.one_of(st.none(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False))
WORDS = st.one_of(st.sampled_from(["good", "good,bad", "uncertain", "", ","]), st.text(max_size=8))


@structured(
    examples=60, outputs=BLOBS, inputs=BLOBS, quality=WORDS, history=st.lists(NUMBERS, min_size=19, max_size=19)
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
        for table, row in {
            "samples": {"outputs": outputs, "inputs": inputs, "output_quality": quality, "input_quality": quality},
            "history": dict(zip(HISTORY_COLUMNS[1:], history, strict=True)),
        }.items():
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
