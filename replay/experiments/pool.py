"""Runs spread over processes: those already finished are read, the others run and kept one by one."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from tqdm import tqdm

from estimator.errors import EstimatorError
from replay.errors import ReplayError
from replay.experiments.jobs import Arrays, Job
from replay.experiments.progress import steps
from replay.experiments.store import load, run_file, save

POLL = 0.5
"""Seconds between looks at how far the processes are."""
_SHARE = 200
"""Steps that a process does between two notes of its progress."""


def run_jobs(jobs: Sequence[Job], folder: Path, *, workers: int, progress: bool) -> list[Arrays]:
    """The results of `jobs`, in their order, kept in `folder` and taken from there where they are.

    With one worker everything runs in this process. Interrupted by Ctrl-C, the finished runs stay and KeyboardInterrupt
    is raised. Raises ReplayError naming the run that failed.
    """
    paths = [run_file(folder, job) for job in jobs]
    results = [load(path) for path in steps(paths, "finished runs", len(paths))]
    missing = [index for index, result in enumerate(results) if result is None]
    total = sum(jobs[index].steps for index in missing)
    note = f"{len(jobs) - len(missing)} of {len(jobs)} runs were there" if len(missing) < len(jobs) else "runs"
    with tqdm(total=total, unit=" steps", unit_scale=True, disable=not progress, desc=note) as bar:
        if workers == 1:
            for index in missing:
                _run_here(jobs[index], paths[index], bar.update)
        elif missing:
            _run_apart([(jobs[index], paths[index]) for index in missing], min(workers, len(missing)), bar)
    for index in missing:
        results[index] = load(paths[index])
    lost = [job.name for job, result in zip(jobs, results, strict=True) if result is None]
    if lost:
        raise ReplayError(f"the run '{lost[0]}' left no readable result in {folder}; run the command again")
    return [result for result in results if result is not None]


def _run_here(job: Job, path: Path, tick: Callable[[int], Any]) -> None:
    try:
        save(path, job.work(job.payload, tick))
    except EstimatorError as error:
        raise ReplayError(f"run '{job.name}': {error}") from error


def _run_apart(todo: list[tuple[Job, Path]], workers: int, bar: Any) -> None:
    context = multiprocessing.get_context("spawn")
    counter = context.Value("q", 0)
    executor = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin, initargs=(counter,))
    try:
        waiting: set[Future[None]] = {executor.submit(_run_there, job, path) for job, path in todo}
        while waiting:
            done, waiting = wait(waiting, timeout=POLL, return_when=FIRST_COMPLETED)
            bar.update(counter.value - bar.n)
            for future in done:
                future.result()
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


_counter: Any = None


def _begin(counter: Any) -> None:
    """In a new process: the parent alone answers Ctrl-C."""
    global _counter
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _counter = counter


def _run_there(job: Job, path: Path) -> None:
    done = 0

    def tick(steps: int) -> None:
        nonlocal done
        done += steps
        if done >= _SHARE:
            _note(done)
            done = 0

    _run_here(job, path, tick)
    _note(done)


def _note(steps: int) -> None:
    with _counter.get_lock():
        _counter.value += steps
