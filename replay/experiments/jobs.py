"""A run of an experiment as data; runs spread over processes, and kept one by one.

A finished run is one file, written whole or not at all, so that an experiment can be gone on with.
"""

import hashlib
import multiprocessing
import os
import pickle
import re
import signal
import zipfile
import zlib
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from pathlib import Path
from tokenize import TokenError
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

import estimator
import replay
import service
from estimator.errors import EstimatorError
from replay.errors import ReplayError
from replay.experiments.progress import steps
from replay.processes import importing_once

Arrays = dict[str, npt.NDArray[Any]]


class Job(NamedTuple):
    """One contender on one recording with one seed: `work(payload)`, a function of a module, so that another process
    finds it, gives named arrays and depends on nothing else."""

    recording: str
    contender: str
    seed: int
    work: Callable[[Any], Arrays]
    payload: Any

    @property
    def name(self) -> str:
        return f"{self.recording} {self.contender}, seed {self.seed}"

    @property
    def fingerprint(self) -> str:
        """Hexadecimal digest of everything that its result depends on: payload, work and source."""
        return hashlib.sha256(_sources() + pickle.dumps((self.work, self.payload))).hexdigest()

    def file(self, folder: Path) -> Path:
        """Where its result belongs; another payload or other code means another file."""
        name = re.sub(r"[^a-z0-9]+", "-", self.name.lower()).strip("-")
        return folder / f"{name}-{self.fingerprint[:16]}.npz"


@cache
def _sources() -> bytes:
    """Digest of the source of the packages that a run goes through."""
    digest = hashlib.sha256()
    for package in (estimator, replay, service):
        for path in sorted(Path(package.__file__ or "").parent.rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.digest()


def run_jobs(jobs: Sequence[Job], folder: Path, workers: int, progress: bool) -> list[Arrays]:
    """The results of `jobs`, in order, kept in and taken from `folder`; one worker is this process. After Ctrl-C the
    finished runs stay and KeyboardInterrupt is raised. ReplayError names a run that failed."""
    paths = [job.file(folder) for job in jobs]
    results = [load(path) for path in steps(paths, "finished runs", len(paths))]
    missing = [index for index, result in enumerate(results) if result is None]
    todo = [(jobs[index], paths[index]) for index in missing]
    with tqdm(total=len(jobs), initial=len(jobs) - len(todo), unit=" runs", disable=not progress, desc="runs") as bar:
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
    executor = ProcessPoolExecutor(workers, importing_once(todo[0][0].work.__module__), signal.signal, ignoring)
    try:
        for future in as_completed([executor.submit(_run, one) for one in todo]):
            future.result()
            bar.update()
        executor.shutdown()
    except BaseException as error:
        # An error or Ctrl-C must not wait for minutes of work that nobody asks for any more.
        processes = multiprocessing.active_children()
        executor.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
            process.join()
        for unfinished in todo[0][1].parent.glob("*.tmp"):
            unfinished.unlink()
        if isinstance(error, BrokenProcessPool):
            raise ReplayError("a process ended by itself, perhaps for want of memory; try --jobs 1") from error
        raise


def load(path: Path) -> Arrays | None:
    """The arrays of a finished run; None where there is none, or a damaged one that has to be run again."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
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
