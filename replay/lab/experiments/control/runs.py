"""One controller in one scene, as a job."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from typing import NamedTuple

import numpy as np

from estimator.network.network import Network
from estimator.offline.least_squares import Segment
from replay.energyplus.plant import STEP
from replay.experiments.jobs import Arrays
from replay.experiments.series.following import frozen
from replay.experiments.series.least_squares import LeastSquaresRun, fit
from replay.experiments.series.recorded_zone import held
from replay.lab.experiments.control import customer
from replay.lab.experiments.control.cases import START, STEPS_A_DAY, Scene
from replay.lab.experiments.control.controllers import EARLY, Planner, Thermostat
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
    fitted = run.controller == LEAST_SQUARES
    if fitted and scene.case == START:
        # Without days before control it is fitted to the first half, in which the thermostat goes on.
        begins = scene.steps // STEPS_A_DAY // 2 * STEPS_A_DAY
    estimator = "ekf" if fitted or run.controller == EKF else run.estimator
    with ExitStack() as opened:

        def make(samples: Mapping[str, Sequence[Sample]]) -> Site:
            networks = networks_of(scene.of, None if estimator == "ekf" else scene.whereabouts.location)
            if fitted:
                networks = {name: _fitted(network, samples[name], scene.seed) for name, network in networks.items()}
            return opened.enter_context(closing(Site(scene.of, networks, estimator, scene.seed, scene.whereabouts)))

        return close(scene, Planner(scene, make, weather_of(scene), begins=begins, trusting=trusting))


def _fitted(network: Network, samples: Sequence[Sample], seed: int) -> Network:
    """`network` held at what fits `samples` best."""
    inputs, outputs = (np.array([getattr(one, field) for one in samples]) for field in ("inputs", "outputs"))
    steps = np.arange(len(inputs))
    segments = [Segment(np.column_stack([held(steps, one, np.inf) for one in inputs.T]), outputs)]
    return frozen(network, fit(LeastSquaresRun(network, STEP, segments, _STARTS, seed))["theta"])


CONTROLLERS = (THERMOSTAT, LEAST_SQUARES, EKF, UNTRUSTING, THERMOGATE, PERFECT)
