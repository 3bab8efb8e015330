"""Runs of an experiment on a real Ray cluster."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from replay.errors import ReplayError
from replay.experiments.cluster import _run_there
from replay.experiments.jobs import Job, fingerprint
from replay.experiments.pool import run_jobs
from replay.experiments.request import Request
from replay.experiments.running import run_experiment
from replay.experiments.semi_synthetic.experiment import prepare
from replay.experiments.store import load, run_file

pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

from support.fleet import PATIENCE, Cluster, environment

CHOSEN = ("EKF", "Kalman filter")
DRIVER = f"""
import sys
from pathlib import Path
from replay.experiments.pool import run_jobs
from replay.experiments.request import Request
from replay.experiments.semi_synthetic.experiment import prepare

jobs = [job for job in prepare(Request(days=1, seeds=(1,))).jobs() if job.label.startswith({CHOSEN})]
run_jobs(jobs, Path(sys.argv[1]), workers=1, progress=False, cluster=sys.argv[2])
"""
"""A process of its own, since Ray reads its environment once."""


@pytest.fixture(scope="module")
def jobs() -> list[Job]:
    return [job for job in prepare(Request(days=1, seeds=(1,))).jobs() if job.label.startswith(CHOSEN)]


def test_a_cluster_finds_what_this_machine_finds(jobs: list[Job], tmp_path: Path) -> None:
    assert len(jobs) > 2
    here = run_jobs(jobs, tmp_path / "here", workers=1, progress=False)
    there = tmp_path / "there"
    there.mkdir()
    with Cluster() as cluster:
        command = [sys.executable, "-c", DRIVER, str(there), cluster.address]
        subprocess.run(command, env=environment(), check=True, timeout=PATIENCE)
    for job, one in zip(jobs, here, strict=True):
        other = load(run_file(there, job))
        assert other is not None, "what has run on a cluster is kept on this machine"
        assert one.keys() == other.keys()
        for name in one.keys() - {"seconds"}:
            np.testing.assert_array_equal(one[name], other[name])


def test_a_machine_with_other_code_says_so(jobs: list[Job]) -> None:
    found = _run_there(jobs[0], "0" * 64)
    assert isinstance(found, str)
    assert "another version of thermogate" in found
    assert isinstance(_run_there(jobs[0], fingerprint(jobs[0])), dict)


def test_what_measures_this_machine_refuses_a_cluster(tmp_path: Path) -> None:
    with pytest.raises(ReplayError, match="--cluster means nothing to cost"):
        run_experiment("cost", Request(), tmp_path, workers=1, progress=False, cluster="auto")
