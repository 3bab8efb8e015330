"""One controller in one scene, as a job."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import replay
import service
from estimator.offline.least_squares import Segment
from replay.energyplus.plant import STEP
from replay.experiments.jobs import Arrays, Job
from replay.experiments.series.following import frozen
from replay.experiments.series.least_squares import LeastSquaresRun, fit
from replay.lab.experiments.control import customer
from replay.lab.experiments.control.cases import CASES, STEPS_A_DAY, Scene
from replay.lab.experiments.control.controllers import EARLY, MakeSite, Planner, Thermostat
from replay.lab.experiments.control.loop import Lived, close, weather_of
from replay.lab.experiments.control.perfect import foreseen
from replay.lab.experiments.control.scores import scores
from replay.lab.experiments.control.site import Site, networks_of
from service.records.sample import Sample

THERMOSTAT, LEAST_SQUARES, EKF = "thermostat", "MPC, least squares", "MPC, EKF"
THERMOGATE, UNTRUSTING, PERFECT = "MPC, Thermogate", "MPC, Thermogate without trust", "MPC, perfect knowledge"

ESTIMATOR = "bank"
"""Thermogate's, as its documentation recommends it for hours ahead."""
_STARTS = 4
_ACTING = ("cases", "controllers", "customer", "loop", "perfect", "scores", "site")
"""The modules of this room that a run depends on."""


class ControlRun(NamedTuple):
    """What a run depends on; `margin` K above the lower end of comfort, `early` s of a thermostat, `code` a digest."""

    scene: Scene
    controller: str
    margin: float = 0.0
    early: float = EARLY
    estimator: str = ESTIMATOR
    code: str = ""


def control_job(run: ControlRun) -> Job:
    """The job of `run`; its arrays are those of `Lived` and, as `scores` (7,), of `Scores`."""
    scene = run.scene
    label = f"{scene.building} {scene.case} {run.controller} {run.margin:+.2f} K {run.early / 60:.0f} min"
    return Job(label, scene.seed, run_control, run._replace(code=_sources()))


def run_control(run: ControlRun) -> Arrays:
    """The arrays of `control_job`."""
    lived = _lived(run)
    return {**lived._asdict(), "scores": np.array(scores(run.scene, lived))}


def _lived(run: ControlRun) -> Lived:
    scene = run.scene
    if run.controller == THERMOSTAT:
        return close(scene, Thermostat(scene, run.margin, run.early))
    if run.controller == PERFECT:
        return foreseen(scene, run.margin)
    trusting, begins = run.controller != THERMOGATE, scene.controlled_from
    make = _online(run, "ekf" if run.controller == EKF else run.estimator)
    if run.controller == LEAST_SQUARES:
        make, begins = _least_squares(run)
    with Planner(scene, make, weather_of(scene), begins=begins, trusting=trusting, margin=run.margin) as planner:
        return close(scene, planner)


def _online(run: ControlRun, estimator: str) -> MakeSite:
    building = run.scene.of
    return lambda samples: Site(building, networks_of(building), estimator, {}, run.scene.seed)


def _least_squares(run: ControlRun) -> tuple[MakeSite, int]:
    """Fitted to the days before control; without any, to the first half, in which the thermostat goes on."""
    scene = run.scene
    begins = scene.controlled_from if CASES[scene.case].history else scene.steps // STEPS_A_DAY // 2 * STEPS_A_DAY

    def make(samples: Mapping[str, Sequence[Sample]]) -> Site:
        networks = {}
        for name, network in networks_of(scene.of).items():
            inputs, outputs = (
                np.array([getattr(sample, field) for sample in samples[name]]) for field in ("inputs", "outputs")
            )
            segments = _unbroken(inputs, outputs)
            theta = fit(LeastSquaresRun(network, STEP, segments, _STARTS, scene.seed))["theta"]
            networks[name] = frozen(network, theta)
        return Site(scene.of, networks, "ekf", {}, scene.seed)

    return make, begins


def _unbroken(inputs: Any, outputs: Any) -> list[Segment]:
    """The recording as one segment, inputs that are missing for a while held."""
    filled = inputs.copy()
    for row in range(1, len(filled)):
        filled[row] = np.where(np.isnan(filled[row]), filled[row - 1], filled[row])
    return [Segment(filled, outputs)]


CONTROLLERS = (THERMOSTAT, LEAST_SQUARES, EKF, UNTRUSTING, THERMOGATE, PERFECT)


@cache
def _sources() -> str:
    """Digest of what a run depends on beyond its payload and the estimators: plant, daemon, controllers, example."""
    replay_folder, service_folder = (Path(package.__file__ or "").parent for package in (replay, service))
    own = [Path(__file__).parent / f"{name}.py" for name in _ACTING]
    folders = (replay_folder / "energyplus", service_folder / "zone", service_folder / "forecast")
    digest = hashlib.sha256()
    for file in [*own, *(file for folder in folders for file in sorted(folder.rglob("*.py"))), customer.PATH]:
        digest.update(file.read_bytes())
    return digest.hexdigest()
