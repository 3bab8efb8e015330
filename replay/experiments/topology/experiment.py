"""`topology`: which RC network to take for a zone, by open-loop least squares (paper 4.3.3, Tables 2 and 3)."""

from replay.experiments.jobs import Arrays, Job
from replay.experiments.request import Request
from replay.experiments.study import Figures, Results, Study
from replay.experiments.topology.data import Recording, recordings
from replay.experiments.topology.fit import TopologyRun, figures, fit, segments, split
from replay.experiments.topology.ranking import Fitted, rank
from replay.experiments.topology.report import report
from replay.reports.kit.report import Report

STARTS = 6
"""Of the optimiser, for each fit: the open-loop error has several minima."""


def prepare(request: Request) -> Study:
    """The experiment for `request`; ReplayError, ServiceError or ConfigError where it cannot be made."""
    request.accept("seeds", "days", "config", "state", "zone", "overrides")
    found = {recording.name: recording for recording in recordings(request)}
    jobs = [job for recording in found.values() for job in _jobs(recording)]
    networks = {(one.name, each.name): each.network for one in found.values() for each in one.candidates}

    def measure(job: Job, arrays: Arrays) -> Figures:
        one = found[job.recording]
        return figures(networks[job.recording, job.contender], one.record, one.windows, arrays, one.time_zone)

    def written(results: Results) -> Report:
        ranked = []
        for one in found.values():
            fits = [Fitted(each, results.runs(one.name, each.name)[0]) for each in one.candidates]
            ranked.append((one, rank(fits)))
        return report(ranked)

    return Study(jobs, measure, written)


def _jobs(recording: Recording) -> list[Job]:
    record, jobs = recording.record, []
    for candidate in recording.candidates:
        network = candidate.network
        known, rest = split(record, recording.windows, network.measured[0])
        whole, before, after = (segments(record, part, network) for part in (recording.windows, known, rest))
        run = TopologyRun(network, record.period, whole, before, after, STARTS)
        jobs.append(Job(recording.name, candidate.name, 0, fit, run))
    return jobs
