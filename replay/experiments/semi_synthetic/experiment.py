"""`semi-synthetic`: a simulated building whose truth is known, with heat gains that no estimator is told of (5.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.gaussian.floor import GAIN_CHANNEL, with_known_gain
from estimator.network.network import Network
from replay.experiments.jobs import Arrays, Job
from replay.experiments.progress import steps
from replay.experiments.report import Report
from replay.experiments.request import Request
from replay.experiments.semi_synthetic.case import HELD, simulated_case
from replay.experiments.semi_synthetic.report import LEAST_SQUARES, Outcome, report
from replay.experiments.semi_synthetic.scores import Fitted, RunScores, open_loop, score, score_fit, true_parameters
from replay.experiments.semi_synthetic.tables import BUILDING
from replay.experiments.series.filtering import FLOOR, FilterRun, Trace, filter_job
from replay.experiments.series.least_squares import LeastSquaresRun, least_squares_job, segments_of
from replay.experiments.series.networks import network_of
from replay.simulated.semi_synthetic import MEASUREMENT_NOISE_SD, PERIOD, PROCESS_NOISE_SD

SEEDS = 5
_STARTS = 3


class Contender(NamedTuple):
    """An online estimator in the comparison; `held` parameters stay at the truth."""

    label: str
    estimator: str
    options: Mapping[str, object]
    held: tuple[str, ...] = ()
    gain_known: bool = False


def contenders(network: Network) -> list[Contender]:
    """Who competes on `network`: on building 67 also with the authors' four parameters held."""
    noise = {"measurement_sd": MEASUREMENT_NOISE_SD}
    paper: dict[str, object] = {"preset": "paper", **noise}
    truth = {"process_sd": PROCESS_NOISE_SD, **noise}
    everything = tuple(parameter.name for parameter in network.parameters)
    free = len(network.free)
    found = [
        Contender(f"RBPF default, {free} free", "rbpf", noise),
        Contender(f"RBPF paper, {free} free", "rbpf", paper),
        # It learns the measurement noise that the others are told.
        Contender(f"MKF, {free} free", "mkf", {}),
    ]
    kalman = [Contender(f"{name.upper()} paper, {free} free", name, paper) for name in ("ekf", "ukf")]
    if network.name == BUILDING and free == len(network.parameters):
        slow: dict[str, object] = paper | {"parameter_sd": 0.001}
        found += [
            Contender("RBPF default, 6 free", "rbpf", noise, HELD),
            Contender("RBPF paper, 6 free", "rbpf", paper, HELD),
            Contender("RBPF paper with a_0 = .99, 6 free", "rbpf", paper | {"shrinkage": 0.99}, HELD),
            Contender("RBPF default, true parameters", "rbpf", noise, everything),
        ]
        kalman += [Contender(f"{name.upper()} paper, 6 free", name, paper, HELD) for name in ("ekf", "ukf")]
        kalman += [
            Contender(f"{name.upper()} paper with walk .001, 6 free", name, slow, HELD) for name in ("ekf", "ukf")
        ]
    return [
        *found,
        *kalman,
        Contender("Kalman filter, true parameters, gain ignored", FLOOR, truth, everything),
        Contender("floor: true parameters, gain known", FLOOR, truth, everything, gain_known=True),
    ]


class SemiSynthetic:
    """The experiment, made ready."""

    def __init__(self, request: Request) -> None:
        request.accept("data", "seeds", "days", "particles", "network", "config", "zone", "overrides")
        self._request = request
        self._network = network_of(request, BUILDING).validate()
        self._seeds = request.seeds_or(SEEDS)
        self._contenders = contenders(self._network)
        self._cases = [simulated_case(self._network, request, seed) for seed in steps(self._seeds, "simulating")]

    def jobs(self) -> list[Job]:
        """Seed by seed, every contender and then the fit."""
        return [job for place in range(len(self._seeds)) for job in self._jobs(place)]

    def _jobs(self, place: int) -> list[Job]:
        seed, case = self._seeds[place], self._cases[place]
        runs = []
        for contender in self._contenders:
            network, series = self._network.with_fixed(contender.held), case.series
            if contender.gain_known:
                network = with_known_gain(network, network.measured[0], GAIN_CHANNEL)
                series = series._replace(inputs=np.column_stack([series.inputs, case.truth.unmeasured_gain]))
            options = dict(contender.options)
            if contender.estimator == "rbpf" and self._request.particles is not None:
                options["particles"] = self._request.particles
            run = FilterRun(contender.estimator, options, network, PERIOD, series, seed)
            runs.append(filter_job(contender.label, run))
        fit = LeastSquaresRun(self._network, PERIOD, segments_of(case.series), _STARTS, seed)
        return [*runs, least_squares_job(LEAST_SQUARES, fit)]

    def report(self, results: Sequence[Arrays]) -> Report:
        """Scores, verdicts, figures."""
        network, each = self._network, len(self._contenders) + 1
        truth = true_parameters(network)
        scores: dict[str, list[RunScores]] = {contender.label: [] for contender in self._contenders}
        fits: list[Fitted] = []
        floors: list[Array] = []
        examples: dict[str, Trace] = {}
        seconds = 0.0
        for place, case in enumerate(self._cases):
            *filtered, fitted = results[place * each : (place + 1) * each]
            for contender, arrays in zip(self._contenders, filtered, strict=True):
                trace = Trace(**arrays)
                # The median, since what else the machine did meanwhile stretches some steps manifold.
                seconds += float(np.median(trace.seconds)) * len(trace.seconds)
                scores[contender.label].append(score(network, case.series, case.truth, trace))
                if place == 0:
                    examples[contender.label] = trace
            fits.append(score_fit(network, case.series, case.truth, fitted["theta"]))
            floors.append(open_loop(network, case.series, case.truth, truth))
        return report(
            Outcome(
                network=network,
                request=self._request,
                seeds=self._seeds,
                scores=scores,
                learners=tuple(c.label for c in self._contenders if len(c.held) < len(network.parameters)),
                fits=fits,
                true_open_loop=floors,
                examples=examples,
                series=self._cases[0].series,
                truth=self._cases[0].truth,
                seconds=seconds,
            )
        )


def prepare(request: Request) -> SemiSynthetic:
    """The experiment for `request`; ReplayError or ConfigError where it cannot be made."""
    return SemiSynthetic(request)
