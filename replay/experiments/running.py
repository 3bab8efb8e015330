"""`thermogate experiment`: from a request to the files of a report, and the door to the laboratory."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from replay.errors import ReplayError
from replay.experiments.catalogue import EXPERIMENTS, LABORATORY, laboratory
from replay.experiments.pool import run_jobs
from replay.experiments.request import Experiment, Request
from replay.reports.kit.report import write_report

RUNS = "runs"
"""Folder under --out that holds the finished runs."""


def run_experiment(name: str, request: Request, out: Path, *, workers: int, progress: bool) -> list[Path]:
    """Run what is missing of the experiment `name`, write its report into `out`; the paths written.

    Finished runs are kept in `out`/runs and reused where neither their settings nor the code has changed. Raises
    ReplayError.
    """
    place = EXPERIMENTS[name].module
    module = laboratory(place, f"experiment {name}") if place.startswith(LABORATORY) else import_module(place)
    experiment: Experiment = module.prepare(request)
    runs = out / RUNS
    try:
        runs.mkdir(parents=True, exist_ok=True)
        results = run_jobs(experiment.jobs(), runs, workers=workers, progress=progress)
    except OSError as error:
        raise ReplayError(f"--out {out}: cannot be written ({error.strerror}); choose another folder") from error
    return write_report(experiment.report(results), out)
