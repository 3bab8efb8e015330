"""Runs of an experiment: known again, kept, gone on with, spread over processes."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from estimator.errors import EstimatorError
from estimator.network.presets import PRESETS
from replay.errors import ReplayError
from replay.experiments.jobs import Arrays, Job, load, run_jobs, save


class Payload(NamedTuple):
    number: float
    folder: str = ""


def double(payload: Payload) -> Arrays:
    """Leaves a mark each time it runs."""
    if payload.number < 0:
        raise EstimatorError("a number below 0")
    if payload.folder:
        marks = Path(payload.folder) / f"{payload.number:g}"
        marks.write_text(marks.read_text() + "x" if marks.exists() else "x")
    return {"doubled": np.array(2 * payload.number)}


def job(number: float, folder: Path | None = None) -> Job:
    return Job("double", f"{number:g}", 1, double, Payload(number, str(folder or "")))


UNLIKE = [
    *((1.0, 1.5), (1, 1.0), ("1", 1), (None, 0.0), ((1, 2), [1, 2]), ((1, (2, 3)), (1, 2, 3)), ({"a": 1}, {"b": 1})),
    *((np.zeros(3), np.zeros((3, 1))), (np.zeros(3), np.zeros(3, dtype=np.float32))),
    (PRESETS["titeth"], PRESETS["titeth"].with_parameter("C_i", upper=2e8)),
]


@pytest.mark.parametrize(("one", "other"), UNLIKE)
def test_other_settings_have_another_fingerprint(one: object, other: object) -> None:
    first, second = (Job("x", "y", 1, double, payload).fingerprint for payload in (one, other))
    assert first == Job("x", "renamed", 2, double, one).fingerprint, "the label changes no result"
    assert first != second


def test_a_damaged_result_counts_as_missing(tmp_path: Path) -> None:
    path = job(1).file(tmp_path)
    assert load(path) is None
    save(path, {"a": np.arange(3)})
    assert load(path)["a"].tolist() == [0, 1, 2]
    whole = path.read_bytes()
    path.write_bytes(whole[:40])
    assert load(path) is None
    for place in range(len(whole)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        read = load(path)
        assert read is None or read["a"].tolist() == [0, 1, 2]
    assert [file.name for file in tmp_path.iterdir()] == [path.name], "no unfinished file is left"


@pytest.mark.parametrize("workers", [1, 2])
def test_finished_runs_are_not_run_again(workers: int, tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    marks.mkdir()
    runs = tmp_path / "runs"
    first = run_jobs([job(1, marks), job(2, marks)], runs, workers=workers, progress=False)
    again = run_jobs([job(2, marks), job(3, marks), job(1, marks)], runs, workers=workers, progress=False)
    assert [float(result["doubled"]) for result in first] == [2, 4]
    assert [float(result["doubled"]) for result in again] == [4, 6, 2], "in the order of the jobs"
    assert {mark.name: mark.read_text() for mark in marks.iterdir()} == {"1": "x", "2": "x", "3": "x"}


@pytest.mark.parametrize("workers", [1, 2])
def test_a_run_that_fails_is_named_and_the_others_stay(workers: int, tmp_path: Path) -> None:
    run_jobs([job(1)], tmp_path, workers=1, progress=False)
    with pytest.raises(ReplayError, match=r"run 'double -1, seed 1': a number below 0"):
        run_jobs([job(1), job(-1), job(-1)], tmp_path, workers=workers, progress=False)
    assert load(job(1).file(tmp_path)) is not None
