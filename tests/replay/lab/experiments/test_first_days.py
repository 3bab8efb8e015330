"""The first days of rooms that are released one after another, on small files of the benchmark's layout."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from replay.experiments.hours_ahead.forecasts import PERSISTENCE
from replay.experiments.hours_ahead.runs import run_hours
from replay.experiments.request import Request
from replay.experiments.study import Results
from replay.lab.experiments import first_days
from replay.lab.experiments.first_days import ALONE, AREA, BESIDE, KNOWN, LEARNED, WRONG, Beside, run_beside
from replay.lab.experiments.rooms import ROOMS

FLAT = [name for name in ROOMS if name.startswith("flat ")]
BEGIN = datetime(2017, 3, 9, tzinfo=UTC)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flat of six rooms, whose temperatures follow the same day, and a twin house; 12 days each."""
    folder = tmp_path_factory.mktemp("data")
    (folder / "rooms").mkdir()
    rng, rows = np.random.default_rng(1), ["room,time,T_room,T_out\n"]
    for name in FLAT:
        for k in range(12 * 96):
            day = np.sin(2 * np.pi * k / 96)
            when = (BEGIN + k * timedelta(minutes=15)).isoformat()
            rows.append(
                f"{name.removeprefix('flat ')},{when},{20 + day + 0.05 * rng.standard_normal():.2f},{5 + day}\n"
            )
    (folder / "rooms/opensmarthome.csv").write_text("".join(rows), encoding="utf-8")
    own = [f"{kind}_{name.removeprefix('twin house ')}" for name in ROOMS if "twin" in name for kind in "TP"]
    rows = [",".join(["time", *own, "T_corridor", "T_attic", "T_cellar", "T_out", "GHI"]) + "\n"]
    for k in range(12 * 144):
        when = (BEGIN + k * timedelta(minutes=10)).isoformat()
        rows.append(",".join([when, *["20"] * len(own), "20", "15", "12", "5", "100"]) + "\n")
    (folder / "rooms/twinhouse_n2.csv").write_text("".join(rows), encoding="utf-8")
    return folder


def test_every_contender_forecasts_the_same_days(data: Path) -> None:
    study = first_days.prepare(Request(data=(data,), recording=("flat",), days=1))
    jobs = {(job.recording, job.contender): job.payload for job in study.jobs}
    alone, beside, learned = (jobs["flat Kitchen", label] for label in (ALONE, BESIDE, LEARNED))
    assert len(alone.series.times) == 96
    assert len(learned.series.times) == 11 * 96
    assert len(beside.others) == first_days.ASKED
    assert all(other.series.times[-1] < alone.series.times[0] for other in beside.others)
    # Nobody knows the floor areas of the flat.
    assert {job.contender for job in study.jobs}.isdisjoint({AREA, KNOWN, WRONG})
    found = {}
    others = tuple(other._replace(estimator="arx") for other in beside.others)
    for label, work, run in (
        (ALONE, run_hours, alone._replace(estimator="arx")),
        (BESIDE, run_beside, Beside(alone._replace(estimator="arx"), others)),
        (LEARNED, run_hours, learned._replace(estimator="arx")),
    ):
        job = next(job for job in study.jobs if (job.recording, job.contender) == ("flat Kitchen", label))
        found[label] = study.measure(job, work(run))
    early = {label: figures["CRPS, K, 6 h, day 1"] for label, figures in found.items()}
    assert "CRPS, K, 6 h, day 30" not in found[ALONE]
    # Others, and the room itself, have seen ten such days.
    assert early[LEARNED] < early[ALONE]
    assert early[BESIDE] < early[ALONE]


def test_a_building_that_is_known_moves_the_prior(data: Path) -> None:
    study = first_days.prepare(Request(data=(data,), recording=("twin house",), days=1, contender=(KNOWN, WRONG)))
    jobs = {(job.recording, job.contender): job.payload for job in study.jobs}
    known, wrong = (jobs["twin house bath", label].network.parameter("C_e") for label in (KNOWN, WRONG))
    assert known.typical == pytest.approx(6.2 * 2.6e5)
    assert wrong.typical == pytest.approx(6.2 * 8e4)


def test_the_report_compares_day_3_with_day_30_over_persistence(data: Path) -> None:
    study = first_days.prepare(Request(data=(data,), recording=("flat",), days=1))
    crps = {PERSISTENCE: 1.0, ALONE: 0.5, BESIDE: 0.4, LEARNED: 0.4}
    figures = []
    for job in study.jobs:
        later = 2.0 if job.contender == BESIDE else 1.0
        keys = first_days._keys()
        figures.append({key: crps[job.contender] * (later if "day 3" in key.split(", ") else 1.0) for key in keys})
    report = study.written(Results(study.jobs, figures))
    rows = {row[1]: row for row in next(table for table in report.tables if table.name == "first-days").rows}
    assert rows[BESIDE][2:6] == pytest.approx((0.4, 0.8, 0.4, 0.4))
    verdicts = next(table for table in report.tables if table.name == "verdicts").rows
    assert [(row[0], row[3]) for row in verdicts] == [
        (f"flat, {label}, {horizon}: day 3 over day 30", met)
        for label, met in ((BESIDE, "missed"), (LEARNED, "met"))
        for horizon in ("6 h", "24 h")
    ]
