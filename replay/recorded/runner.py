"""`thermogate replay`: a recorded period through the daemon's own alignment and worker, as fast as it goes.

Writes per zone `updates.csv` (one row per sample, the interval being the one formed before y was seen) and
`parameters.csv` (posterior mean of each log parameter, exponentiated), and one `summary.json`. At the end it prints
what each zone's model does not know.
"""

import csv
import json
import math
import resource
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

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
from service.records.skill import HorizonSkill, IssuedSkill
from service.zone.worker import ZoneWorker

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
    """Replay the zones of `config` (or one of them) from UTC time `start` up to `end` into the folder `out`; what each
    went through. ServiceError where the folder or a recording cannot be used."""
    tables = [table for table in config.zones if zone in (None, table.id)]
    if seed is not None:
        tables = [table.model_copy(update={"seed": seed}) for table in tables]
    traces, summaries = [], {}
    with writing(out):
        # Scores of an earlier replay must not stand beside the rows of one that fails.
        (out / "summary.json").unlink(missing_ok=True)
        found = read_samples(config, tables, start, end, progress=progress)
        with Progress("replay", sum(len(one.samples) for one in found.values()), progress) as bar:
            for table in tables:
                # What was read of a zone is let go when it is done.
                recorded = found.pop(table.id)
                if (done := _replayed(table, recorded, out / table.id, bar)) is None:
                    raise ServiceError(_unused(table.id, recorded, start, end))
                traces.append(done[0])
                summaries[table.id] = done[1]
        for trace in traces:
            for finding in trace.diagnosis.findings:
                print(f"zone '{trace.zone}': {finding.finding} ({finding.subject}): {finding.sentence}")
        summary = {
            "site": config.site.id,
            "thermogate": version("thermogate"),
            "zones": summaries,
            "peak_memory_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        }
        (out / "summary.json").write_text(json.dumps(_finite(summary), indent=2) + "\n", encoding="utf-8")
    return traces


def _replayed(
    table: ZoneConfig, recorded: Recorded, folder: Path, bar: Progress
) -> tuple[Trace, dict[str, Any]] | None:
    """What a zone went through, whose rows are written into `folder`, and its summary; None without a usable sample."""
    worker, seconds = make_worker(table), list[float]()
    tracer = Tracer(table, worker)
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as opened:
        files = (folder / name for name in ("updates.csv", "parameters.csv"))
        updates, parameters = (
            csv.writer(opened.enter_context(path.open("w", encoding="utf-8", newline="")), lineterminator="\n")
            for path in files
        )
        updates.writerow(HISTORY_COLUMNS)
        parameters.writerow(["time", *(parameter.name for parameter in worker.network.parameters)])
        for sample in recorded.samples:
            update = worker.step(sample)
            bar.update()
            if update is not None:
                tracer.note(update)
                seconds.append(update.step_seconds)
                when = written_time(update.time)
                updates.writerow([when, *(_cell(value) for value in values(tracer.rows[-1])[1:])])
                parameters.writerow([when, *(_cell(value) for value in update.parameters)])
    if not tracer.rows:
        return None
    trace = tracer.trace(recorded.refused)
    return trace, _summary(table, worker, trace, seconds)


def _summary(table: ZoneConfig, worker: ZoneWorker, trace: Trace, seconds: Sequence[float]) -> dict[str, Any]:
    """Scores in the `one_step` convention: the interval published before y_k was seen, against y_k."""
    rows, network, posterior = trace.rows, worker.network, worker.parameters(QUANTILES)
    first_day = [row for row in rows if row.time < rows[0].time + DAY]
    return {
        "convention": "one_step",
        "samples": len(rows),
        "segments": worker.progress.segment,
        "first": written_time(rows[0].time),
        "last": written_time(rows[-1].time),
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
            "mean": 1000 * float(np.mean(seconds)),
            "median": 1000 * float(np.median(seconds)),
            "p99": 1000 * float(np.quantile(seconds, 0.99)),
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
    period = "" if start is None and end is None else " between --start and --end"
    remedy = f"{found.said}; look at timestamp, decimal and unit in the configuration" if found.refused else ""
    return f"zone '{zone}': no usable sample in the recording{period}{remedy}"


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
