"""One controller in one scene, as a job."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from estimator.offline.least_squares import Segment
from replay.energyplus.plant import STEP
from replay.experiments.jobs import Arrays
from replay.experiments.series.following import frozen
from replay.experiments.series.least_squares import LeastSquaresRun, fit
from replay.experiments.series.recorded_zone import held
from replay.lab.experiments.control import customer
from replay.lab.experiments.control.cases import START, STEPS_A_DAY, Scene
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


class ControlRun(NamedTuple):
    """What a run depends on; `margin` K above the lower end of comfort, `early` s of a thermostat, and the text of the
    controller that customers are given."""

    scene: Scene
    controller: str
    margin: float = 0.0
    early: float = EARLY
    estimator: str = ESTIMATOR
    example: str = ""


def with_example(run: ControlRun) -> ControlRun:
    """`run`, which depends on that text."""
    return run._replace(example=customer.PATH.read_text(encoding="utf-8"))


def run_control(run: ControlRun) -> Arrays:
    """The arrays of `Lived` and, as `scores` (7,), those of `Scores`."""
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
    begins = scene.controlled_from if scene.case != START else scene.steps // STEPS_A_DAY // 2 * STEPS_A_DAY

    def make(samples: Mapping[str, Sequence[Sample]]) -> Site:
        networks = {}
        for name, network in networks_of(scene.of).items():
            inputs, outputs = (
                np.array([getattr(one, field) for one in samples[name]]) for field in ("inputs", "outputs")
            )
            steps = np.arange(len(inputs))
            segments = [Segment(np.column_stack([held(steps, one, np.inf) for one in inputs.T]), outputs)]
            theta = fit(LeastSquaresRun(network, STEP, segments, _STARTS, scene.seed))["theta"]
            networks[name] = frozen(network, theta)
        return Site(scene.of, networks, "ekf", {}, scene.seed)

    return make, begins


CONTROLLERS = (THERMOSTAT, LEAST_SQUARES, EKF, UNTRUSTING, THERMOGATE, PERFECT)
