"""Runs spread over the machines of a Ray cluster: a task of one processor each.

A run whose machine is lost is done again on another. Results come back to this machine and are kept as those of
`replay.experiments.pool`, so that one command goes on with what another has begun.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from replay.errors import ReplayError
from replay.experiments.jobs import Arrays, Job, fingerprint
from replay.experiments.store import save
from service.fleet.checks import require_extra
from service.fleet.joining import join, leave

_TRIES_AGAIN = 10
"""How often a run whose machine was lost is begun anew."""
_POLL = 0.5


def run_on_cluster(todo: Sequence[tuple[Job, Path]], address: str, tick: Callable[[int], Any]) -> None:
    """Run every job of `todo` on the cluster at `address` and keep its result at its path.

    `tick` is told the steps of each run that has finished. Raises ReplayError naming the run that failed, and
    ServiceError where the cluster cannot be joined.
    """
    require_extra()
    join(address)
    try:
        _run(todo, tick)
    finally:
        leave()


def _run(todo: Sequence[tuple[Job, Path]], tick: Callable[[int], Any]) -> None:
    import ray
    from ray.exceptions import RayError

    task = ray.remote(num_cpus=1, max_retries=_TRIES_AGAIN)(_run_there)
    running = {task.remote(job, fingerprint(job)): (job, path) for job, path in todo}
    while running:
        for done in ray.wait(list(running), timeout=_POLL)[0]:
            job, path = running.pop(done)
            try:
                found: Arrays | str = ray.get(done)
            except RayError as error:
                raise ReplayError(f"run '{job.name}' ended on its machine: {str(error).splitlines()[-1]}") from error
            if isinstance(found, str):
                raise ReplayError(f"run '{job.name}': {found}")
            save(path, found)
            tick(job.steps)


def _run_there(job: Job, known_as: str) -> Arrays | str:
    """On a machine of the cluster: the arrays of `job`, or why there are none."""
    # Before anything imports Numba.
    from service.daemon.process import prepare_process

    prepare_process()
    from estimator.errors import EstimatorError

    if fingerprint(job) != known_as:
        return "a machine of the cluster has another version of thermogate; install the same one on all of them"
    try:
        return job.work(job.payload, lambda steps: None)
    except EstimatorError as error:
        return str(error)
