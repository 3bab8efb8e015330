"""`first-days`: what a new room forecasts on its first days, alone, with what somebody knows of the building, beside
rooms that have learned, and with a history of its own, the HISTORY days before those that are forecast."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimator.neighbours import Learned, experience
from estimator.network import presets
from estimator.network.buildings import NOTHING_KNOWN, Building
from replay.energyplus.buildings import building_named
from replay.energyplus.library import library
from replay.energyplus.recording import record
from replay.errors import ReplayError
from replay.experiments.hours_ahead.figures import CRPS
from replay.experiments.hours_ahead.forecasts import PERSISTENCE, PlainRun, leads_of, run_naive
from replay.experiments.hours_ahead.recordings import Recording
from replay.experiments.hours_ahead.runs import run_hours
from replay.experiments.jobs import Arrays, Job
from replay.experiments.progress import steps as shown
from replay.experiments.request import Request
from replay.experiments.series.filtering import FilterRun, built, steps
from replay.experiments.study import Figures, Results, Study, targets
from replay.lab.experiments.recordings import FIRST_DAY, energyplus_room
from replay.lab.experiments.rooms import FILES, check_folder, read_room
from replay.localtime import DAY
from replay.reports.kit.document import Document
from replay.reports.kit.report import Report
from replay.reports.kit.table import Cell, Table
from replay.reports.kit.verdict import Verdict, at_most
from service.config.known_heat import usually_heated

HISTORY, DAYS = 10, 30
"""Days before the first day, and those that are scored."""
ASKED = 3
"""Neighbours of a room at most."""
HORIZONS = ("6 h", "24 h")
WINDOWS = {"day 1": (0, 1), "day 3": (1, 4), "day 7": (4, 9), "day 30": (25, 30)}
"""Days of which forecasts are scored together: days about 3, 7 and 30, for those of one day are a dozen."""
ALONE, AREA, KNOWN, WRONG, BESIDE, LEARNED = (
    *("alone", "floor area known", "building known", "building wrong"),
    *("beside neighbours", "with history"),
)
AT_MOST = 1.3
"""CRPS over that of persistence on day 3, over the same on day 30."""


class Room(NamedTuple):
    """A recording, its floor area [m2], and what is known of its building, and wrong of it."""

    recording: Recording
    area: float | None
    known: Building
    wrong: Building


class Beside(NamedTuple):
    """A run that begins with what the `others` have learned."""

    own: FilterRun
    others: tuple[FilterRun, ...]


def prepare(request: Request) -> Study:
    """The experiment for `request`; ReplayError where it cannot be made."""
    request.accept("data", "seeds", "days", "recording", "contender")
    days, seeds = request.days or DAYS, request.seeds_or(1)
    entries = tomllib.loads(files(__package__).joinpath("first_days.toml").read_text(encoding="utf-8"))["sites"]
    names = [entry["name"] for entry in entries]
    for name in request.recording:
        if name not in names:
            raise ReplayError(f"--recording {name}: there is none; the sites are {', '.join(names)}")
    check_folder(request.file, FILES)
    sites = {
        entry["name"]: rooms
        for entry in entries
        if entry["name"] in (request.recording or names) and (rooms := list(_rooms(entry, request.file, days)))
    }
    for name in request.recording:
        if name not in sites:
            raise ReplayError(f"--recording {name}: its file is not there; name the folder that has it with --data")
    jobs = [job for rooms in sites.values() for seed in seeds for job in _jobs(rooms, seed)]
    contenders = {job.contender for job in jobs}
    for name in request.contender:
        if name not in contenders:
            raise ReplayError(f"--contender {name}: there is none; the contenders are {', '.join(sorted(contenders))}")
    asked = (PERSISTENCE, *request.contender)
    found = {room.recording.name: room for rooms in sites.values() for room in rooms}
    return Study(
        [job for job in jobs if not request.contender or job.contender in asked],
        lambda job, arrays: _figures(found[job.recording].recording, arrays),
        lambda results: _report(results, sites, days),
    )


def _rooms(entry: Mapping[str, Any], folder: Path | None, days: int) -> Iterator[Room]:
    """The rooms of a site whose data are there, each with HISTORY and `days` more."""
    known, wrong = (Building(**entry.get(key, {})) for key in ("known", "wrong"))
    if "building" in entry:
        library()
        building, long = building_named(entry["building"]), HISTORY + days
        life = record(building, entry["weather"], begin=FIRST_DAY, days=long, heating=entry["heating"], seed=1)
        for index, room in enumerate(building.rooms):
            yield Room(energyplus_room(life, index), room.size[0] * room.size[1], known, wrong)
        return
    areas = entry.get("areas", [None] * len(entry["rooms"]))
    for name, area in zip(shown(entry["rooms"], "reading", len(areas)), areas, strict=True):
        recording = read_room(name, folder)
        if recording is not None:
            yield Room(recording.first_days(HISTORY + days), area, known, wrong)


def _begins(recording: Recording) -> int:
    return round(HISTORY * DAY / recording.period)


def _jobs(rooms: Sequence[Room], seed: int) -> Iterator[Job]:
    histories = [_run(room.recording, seed, slice(0, _begins(room.recording)))._replace(leads=()) for room in rooms]
    for index, (one, area, known, wrong) in enumerate(rooms):
        if len(one.series.times) <= _begins(one):
            raise ReplayError(f"{one.name}: it has no more than {HISTORY} days; leave it out")
        alone = _run(one, seed, slice(_begins(one), None))
        simple = PlainRun(PERSISTENCE, alone.series, one.period, alone.leads)
        yield Job(one.name, PERSISTENCE, seed, run_naive, simple)
        yield Job(one.name, ALONE, seed, run_hours, alone)
        if area is not None:
            for label, building in ((AREA, NOTHING_KNOWN), (KNOWN, known), (WRONG, wrong)):
                base, where = presets.automatic(one.network.inputs), one.whereabouts.location
                told = usually_heated(base, where, area, building)
                yield Job(one.name, label, seed, run_hours, alone._replace(network=told))
        if others := tuple(history for place, history in enumerate(histories) if place != index)[:ASKED]:
            yield Job(one.name, BESIDE, seed, run_beside, Beside(alone, others))
        yield Job(one.name, LEARNED, seed, run_hours, _run(one, seed, slice(None)))


def _run(one: Recording, seed: int, rows: slice) -> FilterRun:
    leads = tuple(leads_of(one.period).values())
    return FilterRun("bank", {}, one.network, one.period, one.series.rows(rows), seed, one.whereabouts, leads)


def run_beside(run: Beside) -> Arrays:
    """The arrays of `run_hours` of a room that begins with what the others have learned."""
    learned = []
    for other in run.others:
        estimator, known, _ = built(other)
        *_, last = steps(estimator, other.series, other.seed, known)
        learned.append(Learned(estimator, last.state, float(other.series.times[-1] + other.period)))
    return run_hours(run.own._replace(experience=experience(built(run.own)[0], learned) or None))


def _figures(one: Recording, arrays: Arrays) -> Figures:
    """The mean CRPS [K] of each window and horizon, by the time at which the forecast was made."""
    begins, found = _begins(one), {}
    times = one.series.times[begins:]
    for place, (name, lead) in enumerate(leads_of(one.period).items()):
        if name not in HORIZONS:
            continue
        made = (times - times[0] - lead * one.period) / DAY
        scores = arrays["crps"][-len(times) :, place]
        for window, (first, end) in WINDOWS.items():
            known = scores[(made >= first) & (made < end) & np.isfinite(scores)]
            if len(known):
                found[_key(name, window)] = float(known.mean())
    return found


def _key(horizon: str, window: str) -> str:
    return f"{CRPS}, {horizon}, {window}"


def _report(results: Results, sites: Mapping[str, Sequence[Room]], days: int) -> Report:
    document = Document(__package__, "first_days.md")
    rows: list[tuple[Cell, ...]] = []
    verdicts: list[Verdict] = []
    for site, rooms in sites.items():
        for label in results.contenders:
            if label == PERSISTENCE or not any(results.runs(room.recording.name, label) for room in rooms):
                continue
            over = {key: _over_persistence(results, rooms, label, key) for key in _keys()}
            rows.append((site, label, *over.values()))
            verdicts += _verdicts(site, label, over)
    columns = [f"{horizon}, {window}" for horizon in HORIZONS for window in WINDOWS]
    curve = Table("first-days", ("site", "begins", *columns), tuple(rows))
    known = [room.recording.name for rooms in sites.values() for room in rooms]
    sections = [
        document.section("What was done", rooms=", ".join(known), history=HISTORY, days=days, asked=ASKED),
        targets(verdicts),
        document.section("What came out", curve, results.table("crps", _keys())),
    ]
    return Report(document.title, document.lines("Lead", count=len(known)), tuple(sections))


def _keys() -> list[str]:
    return [_key(horizon, window) for horizon in HORIZONS for window in WINDOWS]


def _over_persistence(results: Results, rooms: Sequence[Room], label: str, key: str) -> float | None:
    """Geometric mean over the rooms of the CRPS over that of persistence; None where none has both."""
    pairs = [[results.mean(room.recording.name, one, key) for one in (label, PERSISTENCE)] for room in rooms]
    known = [own / simple for own, simple in pairs if np.isfinite(own) and simple > 0.0]
    return float(np.exp(np.mean(np.log(known)))) if known else None


def _verdicts(site: str, label: str, over: Mapping[str, float | None]) -> Iterator[Verdict]:
    for horizon in HORIZONS if label in (BESIDE, LEARNED) else ():
        early, late = over[_key(horizon, "day 3")], over[_key(horizon, "day 30")]
        ratio = [early / late] if early is not None and late else []
        yield at_most(AT_MOST).judge(f"{site}, {label}, {horizon}: day 3 over day 30", ratio)
