"""The closed loop in short: two days of a timber house, and the parts of which its judgement is made."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import toeplitz
from support.energyplus import needs_energyplus
from support.tables import rows_of

from replay.energyplus.recording import record
from replay.experiments.jobs import Arrays, Job
from replay.experiments.study import Results
from replay.lab.experiments.control.cases import OFF, PARTIES, STEPS_A_DAY, STUCK, UNDISTURBED, Scene, price, steps_with
from replay.lab.experiments.control.loop import BEGIN, weather_of
from replay.lab.experiments.control.perfect import planned
from replay.lab.experiments.control.report import figures, report
from replay.lab.experiments.control.runs import PERFECT, THERMOGATE, THERMOSTAT, UNTRUSTING, ControlRun, run_control
from replay.lab.experiments.control.scores import Scores, cost_at, share_of_the_way
from replay.reports.kit.report import write_report

SHORT = Scene("timber", "denver", UNDISTURBED, seed=1, days=2, controlled=1)


def scored(arrays: Arrays) -> Scores:
    return Scores(*arrays["scores"].tolist())


def lived(controller: str, **settings: object) -> Arrays:
    return run_control(ControlRun(SHORT, controller, **settings))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def runs() -> Mapping[str, Arrays]:
    """A day of every kind of controller. The EKF is a Thermogate that learns quickly."""
    found = {name: lived(name, estimator="ekf") for name in (THERMOSTAT, UNTRUSTING, THERMOGATE)}
    return {**found, PERFECT: lived(PERFECT)}


@needs_energyplus
def test_a_customer_plans_over_rest_and_is_warm(runs: Mapping[str, Arrays]) -> None:
    untrusting = scored(runs[UNTRUSTING])
    assert untrusting.fallback == 0.0
    assert runs[UNTRUSTING]["planned"][-STEPS_A_DAY:].all()
    assert not runs[UNTRUSTING]["planned"][:-STEPS_A_DAY].any(), "history is heated by a thermostat"
    assert untrusting.cold < 10.0, "after a day it keeps a room about as warm as it should be"
    assert (runs[UNTRUSTING]["heating"] <= 6000.0 + 1e-6).all()


@needs_energyplus
def test_where_the_trust_does_not_reach_the_thermostat_heats(runs: Mapping[str, Arrays]) -> None:
    thermogate = scored(runs[THERMOGATE])
    planned_share = runs[THERMOGATE]["planned"][-STEPS_A_DAY:].mean()
    assert thermogate.fallback == pytest.approx(1.0 - planned_share)
    assert thermogate.fallback > 0.5, "a day is too little to be trusted"


@needs_energyplus
def test_a_thermometer_that_is_stuck_is_not_believed() -> None:
    scene = SHORT._replace(case=STUCK, days=3, controlled=2)
    thermostat, thermogate = (
        scored(run_control(ControlRun(scene, name, estimator="ekf"))) for name in (THERMOSTAT, THERMOGATE)
    )
    assert thermostat.discomfort > 100.0, "who believes it heats all day, or not at all"
    assert thermogate.discomfort < 0.5 * thermostat.discomfort


@needs_energyplus
def test_a_boiler_that_is_off_heats_nobody_and_perfect_knowledge_has_heated_before() -> None:
    scene = SHORT._replace(case=OFF, days=3, controlled=2)
    off, lives = steps_with(OFF, scene), [run_control(ControlRun(scene, name)) for name in (THERMOSTAT, PERFECT)]
    for arrays in lives:
        assert off.any()
        assert not arrays["heating"][off].any()
        assert arrays["heating"][~off].any()
    thermostat, perfect = map(scored, lives)
    assert perfect.cold < thermostat.cold - 5.0


@needs_energyplus
def test_everybody_lives_the_same_weather_and_the_same_history(runs: Mapping[str, Arrays]) -> None:
    first = runs[THERMOSTAT]
    for name, arrays in runs.items():
        assert np.array_equal(arrays["outdoor"], first["outdoor"]), name
        history = slice(0, STEPS_A_DAY)
        assert np.allclose(arrays["air"][history], first["air"][history], atol=1e-9), name


@needs_energyplus
def test_what_is_told_of_the_weather_is_that_of_the_step(runs: Mapping[str, Arrays]) -> None:
    recorded = record(SHORT.of, SHORT.weather, begin=BEGIN, days=SHORT.days, heating="planned", seed=1)
    outdoor, sun = weather_of(SHORT)
    assert len(outdoor) == len(sun) == SHORT.steps + STEPS_A_DAY
    for told in (sun[: SHORT.steps], runs[THERMOGATE]["irradiance"]):
        np.testing.assert_allclose(told, recorded.irradiance)
    np.testing.assert_array_equal(outdoor[: SHORT.steps], runs[THERMOGATE]["outdoor"])


@needs_energyplus
def test_nobody_does_better_than_perfect_knowledge(runs: Mapping[str, Arrays]) -> None:
    perfect, others = scored(runs[PERFECT]), [scored(runs[name]) for name in (THERMOSTAT, UNTRUSTING, THERMOGATE)]
    # A kelvin hour at what the others pay per kelvin hour of the margin is a matter of taste; nobody is better in both.
    assert all(other.cost > perfect.cost or other.discomfort > perfect.discomfort for other in others)
    assert perfect.cost < scored(runs[THERMOSTAT]).cost
    assert perfect.cold < scored(runs[UNTRUSTING]).cold + 1.0


@needs_energyplus
def test_the_report_shows_every_controller(runs: Mapping[str, Arrays], tmp_path: Path) -> None:
    found = {name: scored(arrays) for name, arrays in runs.items()}
    dearer = scored(runs[THERMOSTAT])._replace(cost=99.0, cold=0.0, warm=0.0)
    cheaper = scored(runs[PERFECT])._replace(cost=0.1, cold=50.0)
    found |= {f"{THERMOSTAT} +0.30 K 60 min": dearer, f"{PERFECT} -0.30 K 60 min": cheaper}
    scenes = {"timber, undisturbed": SHORT, "timber, parties": SHORT._replace(case=PARTIES)}
    planned = [
        Job(name, label, 1, run_control, ControlRun(scene, THERMOSTAT))
        for name, scene in scenes.items()
        for label in found
    ]
    results = Results(planned, [figures(scores) for _ in scenes for scores in found.values()])
    write_report(report(results, scenes, list(scenes.values())), tmp_path)
    assert "What was done" in (tmp_path / "report.html").read_text(encoding="utf-8")
    undisturbed = [row for row in rows_of(tmp_path / "controllers.csv") if row["recording"] == "timber, undisturbed"]
    table = {row["controller"]: row for row in undisturbed}
    assert set(table) == set(runs)
    # The first of several settings is the usual.
    assert float(table[THERMOSTAT]["cost"]) == scored(runs[THERMOSTAT]).cost
    (way,) = rows_of(tmp_path / "share-of-the-way.csv")
    assert float(way[THERMOGATE]) < 1.0
    targets = {row["target"]: row["verdict"] for row in rows_of(tmp_path / "verdicts.csv")}
    ratio = scored(runs[THERMOGATE]).discomfort / scored(runs[THERMOSTAT]).discomfort
    assert targets["timber, parties: discomfort over that of the thermostat"] == ("met" if ratio <= 1.0 else "missed")


def test_a_joint_plan_heats_a_room_by_its_neighbour_where_that_is_all_the_heat_there_is() -> None:
    steps = 12
    response = toeplitz(1e-3 * 0.95 ** np.arange(steps), np.zeros(steps))
    moved = np.block([[response, 0.0 * response], [0.5 * response, response]])
    free, low, prices = np.full(2 * steps, 19.0), np.full(2 * steps, 20.0), np.full(steps, 0.3)
    both = planned(moved, free, low, prices, np.full((2, steps), 1500.0))
    alone = planned(moved, free, low, prices, np.outer([9000.0, 0.0], np.ones(steps)))
    assert both.shape == (2, steps)
    for powers in (both, alone):
        assert (free + moved @ powers.ravel() >= 20.0 - 1e-6).all()
    assert not alone[1].any()
    assert both.sum() < alone.sum()


def test_cost_at_equal_discomfort_lies_between_settings_that_nobody_beats() -> None:
    def point(discomfort: float, cost: float) -> Scores:
        return Scores(0.0, cost, discomfort, 0.0, 0.0, 0.0, 0.0)

    swept = [point(1.0, 100.0), point(3.0, 90.0), point(2.0, 110.0), point(9.0, 95.0)]
    assert cost_at(swept, 2.0) == pytest.approx(95.0)
    assert cost_at(swept, 0.5) == 100.0
    assert cost_at(swept, 20.0) == 90.0, "who is less comfortable pays no more"
    perfect = [point(1.0, 80.0), point(3.0, 70.0)]
    assert share_of_the_way(point(2.0, 79.0), swept, perfect) == pytest.approx(0.8)
    assert share_of_the_way(point(3.0, 90.0), swept, perfect) == pytest.approx(0.0)
    assert np.isnan(share_of_the_way(point(2.0, 79.0), perfect, perfect))


def test_what_happens_is_part_of_the_controlled_days_alone() -> None:
    for fault in (STUCK, OFF):
        scene = Scene("timber", "denver", fault, seed=1, days=21, controlled=14)
        faulty = steps_with(fault, scene)
        assert faulty.sum() == 2 * STEPS_A_DAY, "a day in each of two weeks"
        assert not faulty[: scene.controlled_from].any()
        assert not steps_with(fault, scene._replace(case=PARTIES)).any()
    assert [price(hour * 3600.0) for hour in (3, 12, 18, 23)] == [0.20, 0.32, 0.48, 0.20]
