"""The experiment on telemetry that lies, on a house that is quickly simulated."""

import numpy as np
import pytest
from support.energyplus import needs_energyplus
from support.thermostat_house import recorded

from replay.experiments.jobs import Arrays, Job
from replay.experiments.request import Request
from replay.experiments.study import Results
from replay.lab.experiments import lies
from replay.lab.experiments.lies import DAY, DAYS, LIES, NOTHING, PERIOD, Watch, afterwards, prepare, watch


@pytest.fixture(scope="module")
def rooms():
    """(1, K, 4): room, outdoor temperature, heating and no sun."""
    outputs, inputs, _ = recorded(DAYS, PERIOD)
    inputs[:, 0] += 0.05 * np.random.default_rng(3).standard_normal(len(inputs))
    return np.column_stack([outputs, inputs, np.zeros(len(inputs))])[None]


@pytest.mark.parametrize("lie", ["sensor stuck", "mW for W", "room and outdoor exchanged"])
def test_hours_count_from_the_lie_on(rooms, lie):
    found = watch(Watch(rooms, lie))
    assert found["any"].shape == (2,)
    assert ((found["any"] > 0.0) & (found["any"] <= 24.0)).all()
    assert (found["named"] >= found["any"]).all()
    assert ((found["false"] >= 0.0) & (found["false"] <= found["any"])).all()


def test_the_truth_has_alarms_and_days(rooms):
    found = watch(Watch(rooms[:, : 12 * 86400 // PERIOD], NOTHING))
    # Without the week that the others are held against, and two days.
    assert (found["alarms"], found["days"]) == (0, 3.0)


def test_forecasts_are_scored_on_the_second_day_after_the_lie(rooms, monkeypatch):
    monkeypatch.setattr(lies, "ESTIMATOR", "ekf")
    monkeypatch.setattr(lies, "TRUE_DAYS", 3)
    monkeypatch.setattr(lies, "LYING_DAYS", 1)
    short, truth = rooms[:, : 6 * DAY].copy(), afterwards(Watch(rooms, NOTHING))
    assert afterwards(Watch(short, NOTHING))["crps"] == truth["crps"], "what comes later is not asked of"
    assert afterwards(Watch(rooms, "kW for W"))["crps"] > truth["crps"], "an EKF keeps what it learned"
    short[0, -DAY // 2 :, 0] += 5.0
    assert afterwards(Watch(short, NOTHING))["crps"] > 2 * truth["crps"]


@needs_energyplus
def test_the_report_has_a_row_for_every_lie():
    study = prepare(Request(building=("timber",), seeds=(1,)))
    assert len(study.jobs) == 3 * (1 + len(LIES)), "forecasts are made in the first recording only"

    def arrays(run: Job) -> Arrays:
        if run.work is afterwards:
            return {"crps": np.array([0.2 if run.contender == NOTHING else 0.3])}
        if run.contender == NOTHING:
            return {"alarms": np.array(1), "days": np.array(30.0)}
        hours = {"any": [2.0, 20.0, np.nan], "named": [20.0, 60.0, np.nan], "false": [0.0, 7.0, np.nan]}
        return {name: np.array(values) for name, values in hours.items()}

    figures = [study.measure(run, arrays(run)) for run in study.jobs]
    found, truth = study.written(Results(study.jobs, figures)).tables
    assert [row[0] for row in found.rows] == list(LIES)
    assert found.rows[0][1:] == pytest.approx((1 / 3, 2 / 3, 2 / 3, 1 / 3, 1 / 2, 1.0, 1.5))
    assert [row[-1].mean for row in truth.rows] == [2.0, 2.0]
