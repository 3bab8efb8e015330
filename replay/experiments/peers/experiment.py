"""`peers`: measured buildings that others have fitted, by least squares and by the online estimators on one split."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from replay.errors import ReplayError
from replay.experiments.jobs import Arrays, Job
from replay.experiments.peers.data import Case, cases
from replay.experiments.peers.report import Outcome, report
from replay.experiments.peers.runs import BoxedRun, boxed_job
from replay.experiments.peers.scores import one_step, open_loop, train_segment
from replay.experiments.report import Report
from replay.experiments.request import Request
from replay.experiments.series.filtering import FilterRun, Trace, filter_job
from replay.experiments.series.least_squares import LeastSquaresRun, least_squares_job

SEEDS = 5
"""Of the particle filter; EKF and UKF draw nothing."""
STARTS = 8


class Contender(NamedTuple):
    """An online estimator; `boxed` ones learn within a box around the least-squares fit of the train part."""

    estimator: str
    boxed: bool

    @property
    def name(self) -> str:
        """What it is called in the report."""
        return f"{self.estimator.upper()}, box around the fit" if self.boxed else f"{self.estimator.upper()}, wide box"


CONTENDERS = tuple(Contender(name, boxed) for boxed in (False, True) for name in ("rbpf", "ekf", "ukf"))


class Peers:
    """The experiment, made ready: its data are read."""

    def __init__(self, request: Request) -> None:
        request.accept("data", "seeds", "particles")
        folder = request.file
        if folder is None:
            raise ReplayError(
                "peers needs measured data, which are not shipped: name the folder that holds them with --data"
            )
        self._request = request
        self._seeds = request.seeds_or(SEEDS)
        self._cases = cases(folder)

    def jobs(self) -> list[Job]:
        """Case by case: the fit, then every online estimator."""
        return [job for case in self._cases for job in self._jobs(case)]

    def _jobs(self, case: Case) -> list[Job]:
        fit = LeastSquaresRun(case.network, case.period, [train_segment(case)], STARTS, 0)
        found = [least_squares_job(f"{case.name} least squares", fit)]
        for contender, seed in self._online():
            name, options = contender.estimator, dict[str, object](measurement_sd=case.measurement_sd)
            if name == "rbpf" and self._request.particles is not None:
                options["particles"] = self._request.particles
            run = FilterRun(name, options, case.network, case.period, case.series, seed)
            label = f"{case.name} {contender.name}"
            found.append(boxed_job(label, BoxedRun(fit, run)) if contender.boxed else filter_job(label, run))
        return found

    def _online(self) -> list[tuple[Contender, int]]:
        return [
            (contender, seed)
            for contender in CONTENDERS
            for seed in (self._seeds if contender.estimator == "rbpf" else self._seeds[:1])
        ]

    def report(self, results: Sequence[Arrays]) -> Report:
        """Figures beside the published ones."""
        rest, outcomes = iter(results), []
        for case in self._cases:
            fitted = next(rest)
            outcome = Outcome(
                case,
                open_loop(case, fitted["theta"], fitted["initial_states"][0]),
                tuple(fitted["at_bound"].tolist()),
                {contender.name: [] for contender in CONTENDERS},
                {contender.name: [] for contender in CONTENDERS},
            )
            for contender, _ in self._online():
                trace = Trace(**next(rest))
                outcome.online[contender.name].append(open_loop(case, trace.theta[case.train - 1]))
                outcome.one_step[contender.name].append(one_step(case, trace))
            outcomes.append(outcome)
        return report(outcomes, self._seeds)


def prepare(request: Request) -> Peers:
    """The experiment for `request`; ReplayError where its data cannot be used."""
    return Peers(request)
