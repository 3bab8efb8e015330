"""`hours-ahead`: every estimator on every recording, from the next step to the next day."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice

from replay.experiments.hours_ahead.horizons import WINDOWS, leads_of, scored_from
from replay.experiments.hours_ahead.outcome import Planned, outcome
from replay.experiments.hours_ahead.recordings import Recording, recordings
from replay.experiments.hours_ahead.report import report
from replay.experiments.hours_ahead.rivals import LEAST_SQUARES, rivals
from replay.experiments.hours_ahead.runs import HoursRun, hours_job
from replay.experiments.jobs import Arrays, Job
from replay.experiments.report import Report
from replay.experiments.request import Request
from replay.experiments.series.filtering import FilterRun

SEEDS = 5
"""Of the estimators; the recordings stay the same."""


class HoursAhead:
    """The experiment, made ready: its recordings are read."""

    def __init__(self, request: Request) -> None:
        request.accept("data", "seeds", "days", "particles", "config", "zone", "overrides")
        self._request = request
        self._seeds = request.seeds_or(SEEDS)
        self._recordings = recordings(request)
        self._rivals = rivals(request)

    def jobs(self) -> list[Job]:
        """Recording by recording: least squares for each window, then every online estimator."""
        return [planned.job for recording in self._recordings for planned in self._planned(recording)]

    def report(self, results: Sequence[Arrays]) -> Report:
        """Scores, verdicts, figures."""
        rest, outcomes = iter(results), []
        for recording in self._recordings:
            planned = list(self._planned(recording))
            outcomes.append(outcome(recording, planned, list(islice(rest, len(planned)))))
        return report(outcomes, self._request, self._seeds)

    def _planned(self, recording: Recording) -> Iterator[Planned]:
        leads = tuple(leads_of(recording.period).values())
        for window, begin in scored_from(recording.series).items():
            fitted = HoursRun(_filter(recording, "ekf", {}, self._seeds[0]), leads, begin)
            yield Planned(LEAST_SQUARES, (window,), hours_job(f"{recording.name} {LEAST_SQUARES} {window}", fitted))
        for rival in self._rivals:
            for seed in self._seeds if rival.seeded else self._seeds[:1]:
                run = HoursRun(_filter(recording, rival.estimator, rival.options, seed), leads)
                yield Planned(rival.label, WINDOWS, hours_job(f"{recording.name} {rival.label}", run))


def _filter(recording: Recording, estimator: str, options: Mapping[str, object], seed: int) -> FilterRun:
    return FilterRun(estimator, options, recording.network, recording.period, recording.series, seed)


def prepare(request: Request) -> HoursAhead:
    """The experiment for `request`; ReplayError, ServiceError or ConfigError where it cannot be made."""
    return HoursAhead(request)
