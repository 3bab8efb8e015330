"""Runs spread over processes: those already finished are read, the others run and kept one by one.

A finished run is one file, written whole or not at all, so that an experiment can be gone on with.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
import zipfile
import zlib
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from tqdm import tqdm

from estimator.errors import EstimatorError
from replay.errors import ReplayError
from replay.experiments.jobs import Arrays, Job, fingerprint
from replay.experiments.progress import steps


def run_jobs(jobs: Sequence[Job], folder: Path, workers: int, progress: bool) -> list[Arrays]:
    """The results of `jobs`, in their order, kept in `folder` and taken from there where they are.

    With one worker everything runs in this process. Interrupted by Ctrl-C, the finished runs stay and KeyboardInterrupt
    is raised. Raises ReplayError naming the run that failed.
    """
    paths = [run_file(folder, job) for job in jobs]
    results = [load(path) for path in steps(paths, "finished runs", len(paths))]
    missing = [index for index, result in enumerate(results) if result is None]
    todo = [(jobs[index], paths[index]) for index in missing]
    found = len(jobs) - len(missing)
    with tqdm(total=len(jobs), initial=found, unit=" runs", disable=not progress, desc="runs") as bar:
        if workers == 1:
            for one in todo:
                _run(one)
                bar.update()
        elif todo:
            _run_apart(todo, min(workers, len(todo)), bar)
    for index in missing:
        results[index] = load(paths[index])
    lost = [job.name for job, result in zip(jobs, results, strict=True) if result is None]
    if lost:
        raise ReplayError(f"the run '{lost[0]}' left no readable result in {folder}; run the command again")
    return [result for result in results if result is not None]


def _run(todo: tuple[Job, Path]) -> None:
    job, path = todo
    try:
        save(path, job.work(job.payload))
    except EstimatorError as error:
        raise ReplayError(f"run '{job.name}': {error}") from error


def _run_apart(todo: Sequence[tuple[Job, Path]], workers: int, bar: Any) -> None:
    # The parent alone answers Ctrl-C.
    ignoring = (signal.SIGINT, signal.SIG_IGN)
    executor = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), signal.signal, ignoring)
    try:
        for future in as_completed([executor.submit(_run, one) for one in todo]):
            future.result()
            bar.update()
        executor.shutdown()
    except BaseException as error:
        _give_up(executor, todo[0][1].parent)
        if isinstance(error, BrokenProcessPool):
            raise ReplayError("a process ended by itself, perhaps for want of memory; try --jobs 1") from error
        raise


def _give_up(executor: ProcessPoolExecutor, folder: Path) -> None:
    """An error or Ctrl-C must not wait for minutes of work that nobody asks for any more."""
    processes = multiprocessing.active_children()
    executor.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()
        process.join()
        for unfinished in folder.glob(f"*.{process.pid}.tmp"):
            unfinished.unlink(missing_ok=True)


def run_file(folder: Path, job: Job) -> Path:
    """Where the result of `job` belongs; another payload or other code means another file."""
    label = re.sub(r"[^a-z0-9]+", "-", job.label.lower()).strip("-")
    return folder / f"{label}-seed{job.seed}-{fingerprint(job)[:16]}.npz"


def load(path: Path) -> Arrays | None:
    """The arrays of a finished run; None where there is none, or a damaged one that has to be run again."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except FileNotFoundError:
        return None
    # What zipfile, zlib and NumPy make of a file in which some byte is another.
    except (OSError, ValueError, EOFError, RuntimeError, TokenError, zipfile.BadZipFile, zlib.error):
        return None


def save(path: Path, arrays: Arrays) -> None:
    """Write `arrays` beside `path` and rename: an interrupted run leaves no half file under its name."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(f".{os.getpid()}.tmp")
    try:
        with unfinished.open("wb") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
