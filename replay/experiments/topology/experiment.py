"""`topology`: which RC network to take for a zone, by open-loop least squares (paper 4.3.3, Tables 2 and 3)."""

from __future__ import annotations

from collections.abc import Sequence

from replay.errors import ReplayError
from replay.experiments.jobs import Arrays, Job
from replay.experiments.request import Request
from replay.experiments.series.recorded_zone import pieces
from replay.experiments.topology.data import Recording, recordings
from replay.experiments.topology.fit import SHORTEST, TopologyRun, fit, score, segments, split
from replay.experiments.topology.ranking import Fitted, rank
from replay.experiments.topology.report import Outcome, report
from replay.localtime import HOUR
from replay.reports.kit.report import Report
from replay.scores.windows import Window

STARTS = 6
"""Of the optimiser, for each fit: the open-loop error has several minima."""


class Topology:
    """The experiment, made ready: its recordings are read and cut into unbroken pieces."""

    def __init__(self, request: Request) -> None:
        request.accept("seeds", "days", "config", "state", "zone", "overrides")
        self._recordings = [(recording, _pieces(recording)) for recording in recordings(request)]

    def jobs(self) -> list[Job]:
        """Recording by recording, every candidate."""
        found = []
        for recording, windows in self._recordings:
            record = recording.record
            for candidate in recording.candidates:
                network = candidate.network
                known, rest = split(record, windows, network.measured[0])
                whole, before, after = (segments(record, part, network) for part in (windows, known, rest))
                run = TopologyRun(network, record.period, whole, before, after, STARTS)
                found.append(Job(f"{recording.name} {candidate.name}", 0, fit, run))
        return found

    def report(self, results: Sequence[Arrays]) -> Report:
        """The ranking of every recording, and the network to take."""
        rest, outcomes = iter(results), []
        for recording, windows in self._recordings:
            fits, fitted = {}, []
            for candidate in recording.candidates:
                fits[candidate.name] = fit = next(rest)
                scored = score(candidate.network, recording.record, windows, fit, recording.time_zone)
                fitted.append(Fitted(candidate, scored, tuple(fit["at_bound"].tolist())))
            outcomes.append(Outcome(recording, windows, rank(fitted), fits))
        return report(outcomes)


def prepare(request: Request) -> Topology:
    """The experiment for `request`; ReplayError, ServiceError or ConfigError where it cannot be made."""
    return Topology(request)


def _pieces(recording: Recording) -> list[Window]:
    """Where every candidate can be fitted: the same rows for all of them."""
    network = recording.candidates[0].network
    outputs = {node for candidate in recording.candidates for node in candidate.network.measured}
    inputs = [channel for channel in recording.record.columns if channel not in outputs]
    found = pieces(recording.record, network.measured[0], inputs, SHORTEST)
    if not found:
        raise ReplayError(
            f"{recording.name}: no {SHORTEST // HOUR} h of the recording have all of {', '.join(inputs)} without a "
            "gap; a longer recording is needed, or larger hold_inputs in its zone"
        )
    return found
