"""`lies`: how soon telemetry that lies is found, by which name, and how often the truth is taken for a lie. Rooms of
EnergyPlus with people lie for four days after ten true ones. A bank is asked only for what remains of a lie: its
forecasts on the second day after, beside those of the same room without the lie."""

from collections.abc import Callable, Mapping
from datetime import date
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis import finding
from estimator.diagnosis.telemetry.lies import Suspicion, believed, looked
from estimator.diagnosis.telemetry.recent import nothing_recent, with_measured
from estimator.network.presets import network
from estimator.thermostat.memory import no_memory
from replay.energyplus.buildings import BUILDINGS, building_named
from replay.energyplus.library import library
from replay.energyplus.plant import STEP
from replay.energyplus.recording import record
from replay.experiments.hours_ahead.runs import run_hours
from replay.experiments.jobs import Arrays, Job
from replay.experiments.progress import steps
from replay.experiments.request import Request
from replay.experiments.series.filtering import FilterRun, Series
from replay.experiments.study import Figures, Results, Study
from replay.reports.kit.document import Document
from replay.reports.kit.report import Report
from replay.reports.kit.table import Cell, Table

PERIOD = round(STEP)
HOUR, DAY = 3600 // PERIOD, 86_400 // PERIOD
DAYS, TRUE_DAYS, LYING_DAYS = 34, 10, 4
ESTIMATOR, AHEAD = "bank", 6 * HOUR
"""Whose forecasts are scored on the second day after a lie, and how many steps ahead."""
ONSETS = (0, 15)
"""Hours of the first lying day at which the lie begins."""

BEGIN = (date(2025, 1, 6), date(2025, 3, 10), date(2025, 11, 3))
"""By seed, in turn."""

NETWORK = network("building-67")
"""Its inputs are those of the columns: outdoor temperature, heating and sun."""

ROOM, OUTDOOR, HEATING = 0, 1, 2
NOTHING = "the truth"
ALARMS, NAMED = "alarms in 60 days", "by its name in 48 h"
AFTERWARDS, AS_TRUE = "CRPS on the second day after", "CRPS on the second day after, over that without a lie"
WITHIN = {f"found in {hours} h": hours for hours in (12, 24, 48)}
SINCE_FALSE = {f"found in {hours} h of the first false reading": hours for hours in (12, 48)}
FALSE = 0.1
"""Share of a column's standard deviation in the true days: what is off the truth by more is a false reading."""


class Lie(NamedTuple):
    """What a column tells instead of its values; `told` is of the lying rows (k, 4) and of those an hour before."""

    column: int
    told: Callable[[Array, Array], Array]
    name: str
    """Of the finding that should come."""


def _spikes(values: Array) -> Array:
    rng = np.random.default_rng(0)
    places = rng.choice(len(values), len(values) // 60, replace=False)
    spiked = values.copy()
    spiked[places] += rng.choice([-8.0, 8.0], len(places))
    return spiked


LIES: Mapping[str, Lie] = {
    "sensor stuck": Lie(ROOM, lambda rows, _: np.full(len(rows), rows[0, ROOM]), finding.SENSOR_STUCK),
    "sensor drifts by .1 K/h": Lie(
        ROOM, lambda rows, _: rows[:, ROOM] + 0.1 / HOUR * np.arange(len(rows)), finding.SENSOR_DRIFTS
    ),
    "sensor tells 2 K more": Lie(ROOM, lambda rows, _: rows[:, ROOM] + 2.0, finding.SENSOR_JUMPED),
    "sensor leaps by 8 K": Lie(ROOM, lambda rows, _: _spikes(rows[:, ROOM]), finding.SENSOR_SPIKES),
    "kW for W": Lie(HEATING, lambda rows, _: rows[:, HEATING] / 1000.0, finding.UNIT_CHANGED),
    "mW for W": Lie(HEATING, lambda rows, _: rows[:, HEATING] * 1000.0, finding.UNIT_CHANGED),
    "meter with the other sign": Lie(HEATING, lambda rows, _: -rows[:, HEATING], finding.SIGN_FLIPPED),
    "meter dead": Lie(HEATING, lambda rows, _: np.zeros(len(rows)), finding.METER_DEAD),
    "meter an hour late": Lie(HEATING, lambda _, before: before[:, HEATING], finding.METER_LATE),
    "outdoor with the other sign": Lie(OUTDOOR, lambda rows, _: -rows[:, OUTDOOR], finding.SIGN_FLIPPED),
    "outdoor stuck": Lie(OUTDOOR, lambda rows, _: np.full(len(rows), rows[0, OUTDOOR]), finding.SENSOR_STUCK),
    "room and outdoor exchanged": Lie(OUTDOOR, lambda rows, _: rows[:, ROOM], finding.CHANNELS_SWAPPED),
}


class Watch(NamedTuple):
    """The rooms of a building, `rows` (r, K, 4), and what is told of them."""

    rows: Array
    lie: str


def prepare(request: Request) -> Study:
    """The experiment for `request`; ReplayError where it cannot be made."""
    request.accept("seeds", "building")
    library()
    jobs, forecast = [], []
    buildings = [building_named(name) for name in request.building or BUILDINGS]
    recordings = [(building, heating) for building in buildings for heating in ("on-off", "proportional")]
    for seed in request.seeds_or(3):
        for place, (building, heating) in enumerate(steps(recordings, "recording")):
            name, begin = building.name, BEGIN[(seed - 1) % len(BEGIN)]
            found = record(building, "denver", begin=begin, days=DAYS, heating=heating, seed=seed)
            shared = [np.broadcast_to(each[:, None], found.air.shape) for each in (found.outdoor, found.irradiance)]
            rows = np.stack([found.air, shared[0], found.heating, shared[1]], axis=-1).transpose(1, 0, 2)
            for lie in (NOTHING, *LIES):
                jobs.append(Job(f"{name}, {heating}", lie, seed, watch, Watch(rows, lie)))
                if place == 0:
                    # A minute and a half each.
                    forecast.append(Job(f"{name}, {heating}", lie, seed, afterwards, Watch(rows[:1], lie)))
    return Study([*jobs, *forecast], lambda job, arrays: _figures(job.contender, arrays), _report)


def watch(run: Watch) -> Arrays:
    """For every room and onset `any`, `named` and `false`: hours until something is found, until it has its name and
    until the first false reading, NaN for never; of the truth `alarms`, the suspicions that began, and `days`."""
    if run.lie == NOTHING:
        alarms = 0
        for rows in run.rows:
            stood_before: set[tuple[str, int]] = set()
            for _, stood in _suspected(rows, 0):
                now = {(one.name, one.column) for one in stood}
                alarms, stood_before = alarms + len(now - stood_before), now
        # Nothing is suspected before there is a reference.
        return {"alarms": np.array(alarms), "days": np.array(len(run.rows) * (run.rows.shape[1] / DAY - 9.0))}
    lie = LIES[run.lie]
    found, named, false = [], [], []
    for rows in run.rows:
        for onset in ONSETS:
            begin = TRUE_DAYS * DAY + onset * HOUR
            lying = _lying(rows, lie, begin)[: begin + LYING_DAYS * DAY]
            wrong = (np.abs(lying - rows[: len(lying)]) > FALSE * rows[:begin].std(axis=0)).any(axis=1)
            false.append((wrong.argmax() - begin) / HOUR if wrong.any() else np.nan)
            looks = [((place - begin) / HOUR, stood) for place, stood in _suspected(lying, begin)]
            found.append(next((hours for hours, stood in looks if stood), np.nan))
            expected = (lie.name, lie.column)
            named.append(next((h for h, stood in looks if expected in {(o.name, o.column) for o in stood}), np.nan))
    return {"any": np.array(found), "named": np.array(named), "false": np.array(false)}


def afterwards(run: Watch) -> Arrays:
    """By room, `crps` [K] of a bank's forecasts AHEAD, made and come true on the second day after the lie."""
    end = (TRUE_DAYS + LYING_DAYS + 2) * DAY
    scores = []
    for rows in run.rows:
        told = rows if run.lie == NOTHING else _lying(rows, LIES[run.lie], TRUE_DAYS * DAY)
        times, starts = PERIOD * np.arange(end), np.arange(end) == 0
        series = Series(times, told[:end, :1], told[:end, 1:], starts)
        found = run_hours(FilterRun(ESTIMATOR, {}, NETWORK, PERIOD, series, 1, leads=(1, AHEAD)))
        scores.append(np.nanmean(found["crps"][end - DAY + AHEAD :, 1]))
    return {"crps": np.array(scores)}


def _lying(rows: Array, lie: Lie, begin: int) -> Array:
    """`rows` (K, 4) that tell a lie for LYING_DAYS from row `begin` on."""
    part, before = slice(begin, begin + LYING_DAYS * DAY), slice(begin - HOUR, begin - HOUR + LYING_DAYS * DAY)
    lying = rows.copy()
    lying[part, lie.column] = lie.told(rows[part], rows[before])
    if lie.name == finding.CHANNELS_SWAPPED:
        lying[part, ROOM] = rows[part, OUTDOOR]
    return lying


def _suspected(rows: Array, begin: int) -> list[tuple[int, tuple[Suspicion, ...]]]:
    width = rows.shape[1] - 1
    # Nobody tells these rooms' set-points.
    recent, untold, looks = nothing_recent(width, PERIOD), no_memory(width), []
    stood: tuple[Suspicion, ...] = ()
    for place, row in enumerate(rows):
        recent = with_measured(recent, place * PERIOD, float(row[0]), row[1:])
        if place >= begin and place % HOUR == HOUR - 1:
            before, time = stood, (place + 1) * PERIOD
            stood = looked(NETWORK, recent, before, time, untold)
            recent = believed(NETWORK, recent, before, stood, time)
            looks.append((place, stood))
    return looks


def _figures(lie: str, arrays: Arrays) -> Figures:
    if "crps" in arrays:
        return {AFTERWARDS: float(np.mean(arrays["crps"]))}
    if lie == NOTHING:
        return {ALARMS: 60.0 * float(arrays["alarms"]) / float(arrays["days"])}
    figures = {label: float(np.mean(arrays["any"] <= hours)) for label, hours in WITHIN.items()}
    # Where nothing false is told, there is nothing to find.
    since = (arrays["any"] - arrays["false"])[np.isfinite(arrays["false"])]
    figures |= {label: float(np.mean(since <= hours)) for label, hours in SINCE_FALSE.items() if len(since)}
    return figures | {NAMED: float(np.mean(arrays["named"] <= max(WITHIN.values())))}


def _report(results: Results) -> Report:
    def over(lie: str, figure: str) -> float:
        """The mean over buildings."""
        return float(np.nanmean([results.mean(name, lie, figure) for name in results.recordings]))

    def as_true(lie: str) -> float:
        """What its forecasts afterwards are like, over those of the same rooms without it."""
        first = results.recordings[0]
        return results.mean(first, lie, AFTERWARDS) / results.mean(first, NOTHING, AFTERWARDS)

    figures = (*WITHIN, NAMED, *SINCE_FALSE)
    rows: list[tuple[Cell, ...]] = [(lie, *(over(lie, figure) for figure in figures), as_true(lie)) for lie in LIES]
    early, document = sum(over(lie, figures[0]) >= 0.5 for lie in LIES), Document(__package__, "lies.md")
    done = {"recordings": ", ".join(results.recordings), "true": TRUE_DAYS, "lying": LYING_DAYS, "onset": ONSETS[-1]}
    done["share"] = FALSE
    lies = Table("lies", ("lie", *figures, AS_TRUE), tuple(rows))
    truth = results.table("truth", [ALARMS], contenders=[NOTHING])
    return Report(
        document.title,
        document.lines("Lead", lies=len(LIES), early=early, alarms=over(NOTHING, ALARMS)),
        (document.section("What was done", **done), document.section("What is found", lies, truth)),
    )
