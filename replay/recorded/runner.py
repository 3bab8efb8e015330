"""`thermogate replay`: a recorded period through the daemon's own alignment and worker, as fast as it goes.

Writes per zone `updates.csv` (one row per sample, the interval being the one formed before y was seen) and
`parameters.csv` (posterior mean of each log parameter, exponentiated), and one `summary.json`. At the end it prints
what each zone's model does not know.
"""

import csv
import json
import math
import resource
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from adapters.fields.durations import format_duration
from adapters.fields.times import written_time
from estimator import registry
from replay.errors import writing
from replay.recorded.trace import Trace, Tracer
from replay.scores.intervals import coverage, mean_width, rmse, winkler
from service.config.fitting import make_worker
from service.config.site import Config, ZoneConfig
from service.errors import ServiceError
from service.recordings.progress import Progress
from service.recordings.samples import Recorded, read_samples
from service.records.history import HISTORY_COLUMNS, HistoryRow
from service.records.record import values
from service.records.sample import Sample
from service.records.skill import HorizonSkill, IssuedSkill

DAY = 86400
QUANTILES = (0.025, 0.25, 0.5, 0.75, 0.975)


def replay_recording(
    config: Config,
    out: Path,
    *,
    zone: str | None = None,
    seed: int | None = None,
    start: float | None = None,
    end: float | None = None,
    progress: bool = True,
) -> list[Trace]:
    """Replay the zones of `config` (or one of them) from UTC time `start` up to `end` into the folder `out`.

    What each zone went through is returned, for a report. Raises ServiceError where the folder or a recording cannot be
    used.
    """
    tables = [table for table in config.zones if zone in (None, table.id)]
    if seed is not None:
        tables = [table.model_copy(update={"seed": seed}) for table in tables]
    with writing(out):
        # Scores of an earlier replay must not stand beside the rows of one that fails.
        (out / "summary.json").unlink(missing_ok=True)
        found = read_samples(config, tables, start, end, progress=progress)
        total = sum(len(one.samples) for one in found.values())
        with (
            ExitStack() as stack,
            Progress("replay", total, progress) as bar,
        ):
            runs = {table.id: stack.enter_context(_recording(table, out / table.id)) for table in tables}
            traces = []
            for name, run in runs.items():
                # What was read of a zone is let go when it is done.
                recorded = found.pop(name)
                for sample in recorded.samples:
                    run.take(sample)
                    bar.update()
                if not run.used:
                    raise ServiceError(_unused(name, recorded, start, end))
                traces.append(run.tracer.trace(recorded.refused))
            for trace in traces:
                for finding in trace.diagnosis.findings:
                    print(f"zone '{trace.zone}': {finding.finding} ({finding.subject}): {finding.sentence}")
            summary = {
                "site": config.site.id,
                "thermogate": version("thermogate"),
                "zones": {trace.zone: runs[trace.zone].summary(trace) for trace in traces},
                "peak_memory_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            }
        (out / "summary.json").write_text(json.dumps(_finite(summary), indent=2) + "\n", encoding="utf-8")
    return traces


class Run:
    """One zone on its way through a recording, and the rows it leaves."""

    def __init__(self, table: ZoneConfig, updates: TextIO, parameters: TextIO) -> None:
        self.table = table
        self._worker = make_worker(table)
        self._updates = csv.writer(updates, lineterminator="\n")
        self._parameters = csv.writer(parameters, lineterminator="\n")
        self._updates.writerow(HISTORY_COLUMNS)
        self._parameters.writerow(["time", *(parameter.name for parameter in self._worker.network.parameters)])
        self.tracer = Tracer(table, self._worker)
        self._seconds: list[float] = []

    def take(self, sample: Sample) -> None:
        """Step through `sample` and write what came of it."""
        update = self._worker.step(sample)
        if update is None:
            return
        self.tracer.note(update)
        row = self.tracer.rows[-1]
        self._seconds.append(update.step_seconds)
        when = written_time(update.time)
        self._updates.writerow([when, *(_cell(value) for value in values(row)[1:])])
        self._parameters.writerow([when, *(_cell(value) for value in update.parameters)])

    @property
    def used(self) -> int:
        """How many samples could be used."""
        return len(self.tracer.rows)

    def summary(self, trace: Trace) -> dict[str, Any]:
        """Scores in the `one_step` convention: the interval published before y_k was seen, against y_k."""
        table, rows = self.table, trace.rows
        first_day = [row for row in rows if row.time < rows[0].time + DAY]
        network = self._worker.network
        posterior = self._worker.parameters(QUANTILES)
        return {
            "convention": "one_step",
            "samples": len(rows),
            "segments": self._worker.progress.segment,
            "first": written_time(rows[0].time) if rows else None,
            "last": written_time(rows[-1].time) if rows else None,
            **_scores(rows, table.levels[0]),
            "after_first_day": _scores(rows[len(first_day) :], table.levels[0]),
            "skill": _skill(() if trace.skill is None else trace.skill.longest),
            "skill_as_issued": _skill(() if trace.skill is None else trace.skill.windows[-1].as_issued),
            "faults": trace.faults,
            "parameters": {}
            if posterior is None
            else {
                p.name: {"unit": p.unit, "free": p.free}
                | {f"q{level:g}": float(value) for level, value in zip(QUANTILES, values, strict=True)}
                for p, values in zip(network.parameters, posterior.parameters, strict=True)
            },
            "findings": [asdict(finding) for finding in trace.diagnosis.findings],
            "variants": {each.variant: each.weight for each in trace.diagnosis.variants},
            "ms_per_update": {
                "mean": 1000 * float(np.mean(self._seconds)) if rows else None,
                "median": 1000 * float(np.median(self._seconds)) if rows else None,
                "p99": 1000 * float(np.quantile(self._seconds, 0.99)) if rows else None,
            },
            "settings": {
                "network": network.name,
                "period_s": table.period,
                "estimator": table.estimator,
                "max_gap": table.max_gap,
                "hold_inputs_s": table.hold_inputs,
                "options": registry.as_mapping(table.options),
            },
            "seed": table.seed,
        }


def _skill(found: Sequence[HorizonSkill | IssuedSkill]) -> dict[str, dict[str, float | None]]:
    """What forecasts of the last 30 days were worth, by lead."""
    return {format_duration(one.lead): _finite(asdict(one)) for one in found}


def _scores(rows: list[HistoryRow], level: float) -> dict[str, float]:
    y, mean, lower, upper = (np.array([getattr(row, name) for row in rows]) for name in ("y", "mean", "lower", "upper"))
    return {
        "scored": int(np.isfinite(y - mean).sum()),
        "level": level,
        "coverage": coverage(y, lower, upper),
        "mean_width_K": mean_width(lower, upper),
        "winkler_K": winkler(y, lower, upper, level),
        "one_step_rmse_K": rmse(y - mean),
    }


def _unused(zone: str, found: Recorded, start: float | None, end: float | None) -> str:
    """Why a replay brought nothing, in one sentence."""
    period = "" if start is None and end is None else " between --start and --end"
    remedy = f"{found.said}; look at timestamp, decimal and unit in the configuration" if found.refused else ""
    return f"zone '{zone}': no usable sample in the recording{period}{remedy}"


@contextmanager
def _recording(table: ZoneConfig, folder: Path) -> Iterator[Run]:
    folder.mkdir(parents=True, exist_ok=True)
    with (
        (folder / "updates.csv").open("w", encoding="utf-8", newline="") as updates,
        (folder / "parameters.csv").open("w", encoding="utf-8", newline="") as parameters,
    ):
        yield Run(table, updates, parameters)


def _cell(value: float | bool | int) -> str:
    """A number in full; nothing for NaN."""
    if isinstance(value, bool):
        return str(int(value))
    return "" if isinstance(value, float) and math.isnan(value) else repr(value)


def _finite(value: Any) -> Any:
    """`value` with None for what JSON cannot hold."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
