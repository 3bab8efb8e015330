"""Runs spread over processes: those already finished are read, the others run and kept one by one."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from tqdm import tqdm

from estimator.errors import EstimatorError
from replay.errors import ReplayError
from replay.experiments.jobs import Arrays, Job
from replay.experiments.progress import steps
from replay.experiments.store import load, run_file, save


def run_jobs(jobs: Sequence[Job], folder: Path, *, workers: int, progress: bool) -> list[Arrays]:
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
