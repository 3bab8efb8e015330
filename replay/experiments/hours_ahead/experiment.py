"""`hours-ahead`: every contender on every recording, from the next step to the next day."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import tomli_w

from estimator import registry
from replay.errors import ReplayError
from replay.experiments.hours_ahead import figures, forecasts
from replay.experiments.hours_ahead.answered import ANSWERED, LIVE, SCHEDULED, WEATHER
from replay.experiments.hours_ahead.contenders import BANK, contenders, jobs_of
from replay.experiments.hours_ahead.direct import BLIND
from replay.experiments.hours_ahead.figures import COVERAGE, CRPS, GAIN, LARGEST, LEARNED, LOSS, RMSE, SCORES, key
from replay.experiments.hours_ahead.forecasts import FIRST_DAYS, LATER, PERSISTENCE, leads_of
from replay.experiments.hours_ahead.recordings import Recording, recordings
from replay.experiments.hours_ahead.runs import PLANNED, SAMPLES
from replay.experiments.request import Request
from replay.experiments.study import Contender, Results, Study, targets
from replay.localtime import DAY, HOUR
from replay.reports.kit.document import Document
from replay.reports.kit.report import Report, Section
from replay.reports.kit.table import Cell, Table
from replay.reports.kit.verdict import Verdict, at_most, between

SEEDS = 5
"""Of the estimators; the recordings stay the same."""

OVER_BEST = 1.02
ON_AVERAGE = 0.85
COVERED = (0.93, 0.97)
FIRST = {"6 h": 0.8, "24 h": 0.95}
"""CRPS of the bank over that of persistence in the first three days."""
FARTHEST = 4.0
"""K from its mean to what came 6 h later, at most, in the first three days."""
GAIN_OFF = 0.7
"""Share by which the gain that was learned of a building of EnergyPlus may be off."""
NEAR = {"6 h": 0.4, "24 h": 0.45}
"""RMSE [K] under the set-points and the weather that came."""
ANSWERS_COVERED = (0.92, 0.97)
OVER_RIVAL = {False: 0.75, True: 0.8}
"""CRPS of `live` over that of the best that knows no more, of simulated (False) and measured rooms."""
_NEAR_THE_TRUTH = between(0.8, 1.2)


class Standing(NamedTuple):
    """A contender, the geometric mean and the largest of a ratio, and where it is largest."""

    label: str
    mean: float
    worst: float
    where: str


def prepare(request: Request) -> Study:
    """The experiment for `request`; ReplayError, ServiceError, ConfigError or OptionsError where it cannot be made."""
    request.accept("data", "seeds", "days", "particles", "config", "zone", "overrides", "contender", "recording")
    if request.config is not None and (request.data or request.recording):
        option = "--data is a folder of recordings" if request.data else "--recording chooses one of the laboratory"
        raise ReplayError(f"{option}, and --config has its own; give one of the two")
    seeds, entered = request.seeds_or(SEEDS), contenders(request)
    found = {recording.name: recording for recording in recordings(request)}
    for one in entered:
        if one.estimator.startswith(SCHEDULED) and all(known.series.setpoints is None for known in found.values()):
            raise ReplayError(
                f"--contender {one.label}: no recording has a set-point; give the zone a [zones.setpoint]"
            )
    jobs = [job for recording in found.values() for one in entered for job in jobs_of(one, recording, seeds)]
    return Study(
        jobs,
        lambda job, arrays: figures.figures(found[job.recording], arrays),
        lambda results: _report(results, found, entered, request, seeds),
    )


def _report(
    results: Results,
    known: Mapping[str, Recording],
    entered: Sequence[Contender],
    request: Request,
    seeds: Sequence[int],
) -> Report:
    compared, first = ranked(results, known, LATER), ranked(results, known, FIRST_DAYS, PERSISTENCE)
    document, found = Document(__package__), verdicts(results, known)
    listed = [
        document.lines(
            "Recording",
            name=one.name,
            what=one.what,
            samples=len(one.series.times),
            minutes=one.period // 60,
            days=float(one.series.times[-1] - one.series.times[0]) / DAY,
        )[0]
        for one in known.values()
    ]
    taken = [results.values(name, label, "seconds") for name in known for label in results.contenders]
    sections = [
        document.section(
            "What was done",
            listed="; ".join(listed),
            seeds=", ".join(map(str, seeds)),
            particles="" if request.particles is None else f"RBPF with {request.particles:,} particles.",
            every=forecasts.EVERY // HOUR,
            minutes=sum(map(sum, taken)) / 60,
            thinned=SAMPLES,
        ),
        targets(found, *document.lines("On the targets")) if found else document.section("Targets"),
        document.section(
            "Which forecast is best?",
            _ranking("ranking", compared),
            *(_across(results, known, score, LATER) for score in (CRPS, COVERAGE)),
        ),
        document.section(
            "The first three days",
            _ranking("first-three-days-over-persistence", first) if first else None,
            *(_across(results, known, score, FIRST_DAYS) for score in (CRPS, COVERAGE, LARGEST)),
        ),
    ]
    if any(recording.known is not None for recording in known.values()):
        sections.append(document.section("Is what was learned true?", results.table("truth", LEARNED)))
    sections.append(_settings(document, results, known, entered, compared))
    lead = [line for standing in compared[:3] for line in document.lines("Lead", **standing._asdict())]
    files = {"scores.csv": _in_full(results, known).csv()}
    return Report(document.title, tuple(lead), tuple(sections), files)


def verdicts(results: Results, known: Mapping[str, Recording]) -> list[Verdict]:
    """Every target of the bank, and of the zone that is asked; none where they did not run."""
    return [*_of_bank(results, known), *_of_answers(results, known)]


def _of_answers(results: Results, known: Mapping[str, Recording]) -> Iterator[Verdict]:
    """Targets of forecasts under the set-points and weather that came, and of those without a plan."""
    for name, recording in known.items():
        for label in (one for one in results.contenders if one in ANSWERED):
            for horizon in [one for one in forecasts.AHEAD if one in leads_of(recording.period)]:
                coverage = results.values(name, label, key(COVERAGE, horizon))
                yield between(*ANSWERS_COVERED).judge(f"{name}, {horizon}: coverage of '{label}'", coverage)
        for horizon, limit in NEAR.items():
            if near := results.values(name, SCHEDULED + WEATHER, key(RMSE, horizon)):
                yield at_most(limit).judge(f"{name}, {horizon}: RMSE of '{SCHEDULED + WEATHER}', K", near)
        for horizon in ("24 h",) if recording.measured else ("6 h", "24 h"):
            own = results.values(name, LIVE, key(CRPS, horizon))
            rivals = (PERSISTENCE, forecasts.YESTERDAY, *((BLIND,) if recording.measured else ()))
            others = _means(results, name, key(CRPS, horizon), [one for one in rivals if one in results.contenders])
            if own and others:
                best, limit = min(others, key=others.__getitem__), OVER_RIVAL[recording.measured]
                text = f"{name}, {horizon}: CRPS of '{LIVE}' over that of the best that knows no more, {best}"
                yield at_most(limit).judge(text, [value / others[best] for value in own])


def _of_bank(results: Results, known: Mapping[str, Recording]) -> Iterator[Verdict]:
    if BANK not in results.contenders:
        return
    ratios: dict[str, list[float]] = {"6 h": [], "24 h": []}
    for name, recording in known.items():
        for horizon in leads_of(recording.period):
            own = results.values(name, BANK, key(CRPS, horizon))
            rivals = [one for one in results.contenders if one not in (BANK, PLANNED, *ANSWERED)]
            others = _means(results, name, key(CRPS, horizon), rivals)
            if own and others:
                best = min(others, key=others.__getitem__)
                ratios.setdefault(horizon, []).append(float(np.mean(own)) / others[best])
                text = f"{name}, {horizon}: CRPS of the bank over that of the best other forecast, {best}"
                yield at_most(OVER_BEST).judge(text, [value / others[best] for value in own])
                coverage = results.values(name, BANK, key(COVERAGE, horizon))
                yield between(*COVERED).judge(f"{name}, {horizon}: coverage of the bank", coverage)
    for horizon in ("6 h", "24 h"):
        text = f"{horizon}: CRPS of the bank over that of the best other forecast, geometric mean over recordings"
        yield at_most(ON_AVERAGE).judge(text, _geometric(ratios[horizon]))
    for horizon, limit in FIRST.items():
        text = f"first three days, {horizon}: CRPS of the bank over that of persistence, geometric mean over recordings"
        early = [_means(results, name, key(CRPS, horizon, FIRST_DAYS), [BANK, PERSISTENCE]) for name in known]
        each = [crps[BANK] / crps[PERSISTENCE] for crps in early if len(crps) == 2]
        yield at_most(limit).judge(text, _geometric(each))
    for name in known:
        for figure, said, wanted in (
            (key(LARGEST, "6 h", FIRST_DAYS), "first three days: largest error 6 h ahead, K", at_most(FARTHEST)),
            (LOSS, "heat loss of the bank after three weeks, over the true one", _NEAR_THE_TRUTH),
            (GAIN, "rms error of the gain of the bank after three weeks, over its rms", at_most(GAIN_OFF)),
        ):
            if values := results.values(name, BANK, figure):
                separator = ", " if figure not in (LOSS, GAIN) else ": "
                yield wanted.judge(f"{name}{separator}{said}", values)


def _means(results: Results, recording: str, figure: str, labels: Sequence[str]) -> dict[str, float]:
    """The figure's mean over seeds by contender, of those that have one."""
    means = {label: results.mean(recording, label, figure) for label in labels}
    return {label: mean for label, mean in means.items() if np.isfinite(mean)}


def _geometric(ratios: Sequence[float]) -> list[float]:
    return [float(np.exp(np.mean(np.log(ratios))))] if ratios else []


def ranked(results: Results, known: Mapping[str, Recording], window: str, over: str | None = None) -> list[Standing]:
    """CRPS over the smallest of all, or over that of `over`, across recordings and horizons; the best first."""
    found: dict[str, dict[str, float]] = {label: {} for label in results.contenders}
    for name, recording in known.items():
        for horizon in leads_of(recording.period):
            crps = _means(results, name, key(CRPS, horizon, window), results.contenders)
            base = crps.get(over, np.nan) if over else min(crps.values(), default=np.nan)
            if base > 0.0:
                for label, value in crps.items():
                    found[label][f"{name}, {horizon}"] = value / base
    standings = [
        Standing(label, _geometric(list(cells.values()))[0], max(cells.values()), max(cells, key=cells.__getitem__))
        for label, cells in found.items()
        if cells
    ]
    return sorted(standings, key=lambda standing: standing.mean)


def _ranking(name: str, standings: Sequence[Standing]) -> Table:
    return Table(name, ("forecast", "geometric mean", "worst", "where it is worst"), tuple(standings))


def _across(results: Results, known: Mapping[str, Recording], score: str, window: str) -> Table:
    horizons = dict.fromkeys(horizon for recording in known.values() for horizon in leads_of(recording.period))
    name = {CRPS: "crps", COVERAGE: "coverage", LARGEST: "largest-error"}[score]
    figures = {horizon: key(score, horizon, window) for horizon in horizons}
    return results.across(f"{name}-{window.replace(' ', '-')}", figures, "ahead")


def _settings(
    document: Document,
    results: Results,
    known: Mapping[str, Recording],
    entered: Sequence[Contender],
    compared: Sequence[Standing],
) -> Section:
    online = {one.label: one for one in entered if one.estimator in registry.ESTIMATORS}
    standing = next((one for one in compared if one.label in online), None)
    if standing is None:
        return document.section("Nothing to set")._replace(title="What to set")
    contender = online[standing.label]
    zone: dict[str, object] = {"estimator": contender.estimator}
    zone |= {"estimator_options": dict(contender.options)} if contender.options else {}
    narrow = ", ".join(
        f"{name}, {horizon} ({100 * share:.0f} %)"
        for name, recording in known.items()
        for horizon in leads_of(recording.period)
        if (share := results.mean(name, standing.label, key(COVERAGE, horizon))) < 0.9
    )
    return document.section(
        "What to set",
        **standing._asdict(),
        toml=f"```\n{tomli_w.dumps({'zones': [zone]})}```",
        narrow=f"Keep a margin where its 95 % interval covered less than 90 %: {narrow}." if narrow else "",
    )


def _in_full(results: Results, known: Mapping[str, Recording]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for name, recording in known.items():
        for window in forecasts.WINDOWS:
            for horizon in leads_of(recording.period):
                for label in results.contenders:
                    cells = [results.spread(name, label, key(score, horizon, window)) for score in SCORES]
                    if any(cell is not None for cell in cells):
                        rows.append((name, window, horizon, label, *cells))
    return Table("scores", ("recording", "window", "ahead", "forecast", *SCORES), tuple(rows))
