"""An experiment as data: contenders on recordings, named figures of every run, and tables of them over seeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from replay.experiments.jobs import Arrays, Job
from replay.experiments.progress import steps
from replay.reports.kit.report import Report, Section
from replay.reports.kit.table import Cell, Spread, Table, spread
from replay.reports.kit.verdict import Verdict, verdict_table

Figures = Mapping[str, float]
"""What a run came to, by name; NaN where a figure is not defined."""


class Contender(NamedTuple):
    """An estimator with its options; `label` is its name in tables, `held` parameters stay at their nominal values."""

    label: str
    estimator: str
    options: Mapping[str, object]
    held: tuple[str, ...] = ()

    def with_particles(self, count: int | None) -> Contender:
        """With `count` particles where it is an RBPF; None leaves it as it is."""
        if count is None or self.estimator != "rbpf":
            return self
        return self._replace(options={**self.options, "particles": count})


class Results:
    def __init__(self, jobs: Sequence[Job], figures: Sequence[Figures]) -> None:
        self._figures: dict[tuple[str, str], list[Figures]] = {}
        for job, found in zip(jobs, figures, strict=True):
            self._figures.setdefault((job.recording, job.contender), []).append(found)
        self.recordings = list(dict.fromkeys(job.recording for job in jobs))
        self.contenders = list(dict.fromkeys(job.contender for job in jobs))

    def runs(self, recording: str, contender: str) -> Sequence[Figures]:
        return self._figures.get((recording, contender), ())

    def values(self, recording: str, contender: str, figure: str) -> list[float]:
        """One figure of every seed; empty where it was not found."""
        return [found[figure] for found in self.runs(recording, contender) if figure in found]

    def mean(self, recording: str, contender: str, figure: str) -> float:
        """Its mean over seeds; NaN where it is not known."""
        values = self.values(recording, contender, figure)
        return float(np.mean(values)) if values else float("nan")

    def spread(self, recording: str, contender: str, figure: str) -> Spread | None:
        """Its mean and standard deviation over seeds; None where it is not known."""
        values = self.values(recording, contender, figure)
        return spread(values) if values and np.isfinite(values).all() else None

    def table(
        self,
        name: str,
        columns: Mapping[str, str] | Sequence[str],
        *,
        contenders: Sequence[str] | None = None,
        quoted: Mapping[str, Sequence[Cell]] | None = None,
        heading: str = "estimator",
    ) -> Table:
        """A row for every recording (named where there are several) and contender that has any figure, a column for
        each figure of `columns`, by heading where that is another; `heading` is that of the contenders. `quoted` are
        published rows by label, below ours."""
        columns = columns if isinstance(columns, Mapping) else {name: name for name in columns}
        named = len(self.recordings) > 1
        rows: list[tuple[Cell, ...]] = []
        for recording in self.recordings:
            for contender in contenders or self.contenders:
                cells = [self.spread(recording, contender, figure) for figure in columns.values()]
                if any(cell is not None for cell in cells):
                    rows.append((*((recording,) if named else ()), contender, *cells))
        rows += [(*(("",) if named else ()), label, *cells) for label, cells in (quoted or {}).items()]
        head = ("recording", heading) if named else (heading,)
        return Table(name, (*head, *columns), tuple(rows), quoted=len(quoted or {}))

    def across(self, name: str, figures: Mapping[str, str], heading: str) -> Table:
        """A row for every recording and figure, a column for each contender; `figures` is by the label of the row."""
        rows: list[tuple[Cell, ...]] = []
        for recording in self.recordings:
            for label, figure in figures.items():
                cells = [self.spread(recording, contender, figure) for contender in self.contenders]
                if any(cell is not None for cell in cells):
                    rows.append((recording, label, *cells))
        return Table(name, ("recording", heading, *self.contenders), tuple(rows))


def targets(found: Sequence[Verdict], *notes: str) -> Section:
    """How many targets are met, `notes` on them, and all of them as a table."""
    met, missed = (sum(verdict.met is state for verdict in found) for state in (True, False))
    counted = f"{met} of {len(found)} are met, {missed} missed, {len(found) - met - missed} open."
    return Section("Targets", (counted, *notes), (verdict_table(found),))


@dataclass(frozen=True)
class Study:
    """An experiment: its runs, the figures of a run from its arrays, and the report of all figures."""

    jobs: Sequence[Job]
    measure: Callable[[Job, Arrays], Figures]
    written: Callable[[Results], Report]

    def report(self, results: Sequence[Arrays]) -> Report:
        """The report of the results, which come in the order of the jobs; each is measured and let go."""
        pairs = steps(zip(self.jobs, results, strict=True), "scoring", len(self.jobs))
        return self.written(Results(self.jobs, [self.measure(*pair) for pair in pairs]))
