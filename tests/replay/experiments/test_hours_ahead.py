"""Forecasts of the hours ahead: their scores against naive ones, and the experiment in short."""

from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr
from support.tables import rows_of, tabled

from estimator import registry
from estimator.heat.terms import with_known_heat
from estimator.network import presets
from estimator.network.presets import PRESETS, automatic
from estimator.types import Mixture
from replay.errors import ReplayError
from replay.experiments.hours_ahead.answered import LIVE, SCHEDULED, AnsweredRun, run_answered
from replay.experiments.hours_ahead.contenders import contenders, jobs_of, named, seeded
from replay.experiments.hours_ahead.direct import BLIND, RIDGE, regressors, run_direct
from replay.experiments.hours_ahead.experiment import COVERED, OVER_BEST, prepare
from replay.experiments.hours_ahead.figures import figures, key
from replay.experiments.hours_ahead.forecasts import (
    FIRST_DAYS,
    LATER,
    PERSISTENCE,
    YESTERDAY,
    Forecasts,
    PlainRun,
    issued,
    leads_of,
    no_forecasts,
    run_naive,
    windows_of,
)
from replay.experiments.hours_ahead.recordings import Recording
from replay.experiments.hours_ahead.runs import run_hours
from replay.experiments.request import Request
from replay.experiments.series.filtering import FilterRun, Series
from replay.lab.experiments.recordings import RECORDINGS
from replay.lab.experiments.semi_synthetic.building import simulated_case
from replay.localtime import DAY, HOUR
from replay.simulated.semi_synthetic import PERIOD
from service.cli.main import main
from service.config.fitting import known_heat
from service.config.site import Whereabouts

ROOT = Path(__file__).parents[3]
DATA = ROOT.parent / "shared" / "data"
measured = pytest.mark.skipif(not DATA.is_dir(), reason="the measured data are not beside the project")
DAY_STEPS = DAY // PERIOD


def series(outputs: list[float], starts: tuple[int, ...] = (0,), period: int = 6 * HOUR) -> Series:
    marks = np.zeros(len(outputs), dtype=np.bool_)
    marks[list(starts)] = True
    # A segment after the first begins an interval late.
    times = period * (np.arange(len(outputs)) + np.cumsum(marks) - 1)
    return Series(times, np.array(outputs)[:, None], np.zeros((len(outputs), 1)), marks)


def test_a_horizon_of_one_step_appears_once() -> None:
    assert leads_of(600) == {"1 step": 1, "1 h": 6, "6 h": 36, "24 h": 144}
    assert leads_of(3600) == {"1 step": 1, "6 h": 6, "24 h": 24}
    assert leads_of(2 * DAY) == {"1 step": 1}


def test_forecasts_are_made_within_a_segment_and_every_two_hours() -> None:
    record = series([0.0] * 10, (0, 6), period=HOUR)
    assert issued(record, HOUR, 1).tolist() == [0, 1, 2, 3, 4, 6, 7, 8]
    assert issued(record, HOUR, 3).tolist() == [0, 2, 6]


def test_the_first_days_are_three_or_the_first_half_of_a_short_record() -> None:
    assert windows_of(series([0.0] * 40)) == {FIRST_DAYS: (0, 12), LATER: (12, 40)}
    assert windows_of(series([0.0] * 14)) == {FIRST_DAYS: (0, 7), LATER: (7, 14)}


def naive(name: str, record: Series, *leads: int) -> np.ndarray:
    return run_naive(PlainRun(name, record, 6 * HOUR, leads))["mean"]


def test_persistence_and_yesterday_are_exact() -> None:
    y = [1.0, 2.0, 4.0, 8.0, np.nan, 32.0, 64.0, 128.0, 256.0, 512.0]
    still, day_before = (naive(name, series(y), 1, 4) for name in (PERSISTENCE, YESTERDAY))
    np.testing.assert_array_equal(still[:, 0], [np.nan, 1, 2, 4, 8, 8, 32, 64, 128, 256])
    np.testing.assert_array_equal(still[:, 1], [np.nan] * 4 + [1, 2, 4, 8, 8, 32])
    # Four steps before; the last value where the record does not reach back, the one before where nothing was measured.
    np.testing.assert_array_equal(day_before[:, 0], [np.nan, 1, 2, 4, 1, 2, 4, 8, 8, 32])
    np.testing.assert_array_equal(day_before[:, 1], still[:, 1])


def test_yesterday_looks_across_a_gap() -> None:
    # Rows 5 and 6 are 24 h after rows 2 and 3, for the gap has taken one interval.
    day_before = naive(YESTERDAY, series([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], (0, 4)), 1)
    np.testing.assert_array_equal(day_before[:, 0], [np.nan, 1, 2, 3, np.nan, 3, 4])


def lived_in(days: int = 5) -> Series:
    """An hourly record of a room that is linear in its inputs, with noise that never repeats."""
    rng = np.random.default_rng(7)
    count = 24 * days
    inputs = np.column_stack([5 + 4 * np.sin(np.arange(count) / 4), 1000.0 * (rng.random(count) < 0.4)])
    y = np.full(count, 20.0)
    for k in range(1, count):
        y[k] = 0.9 * y[k - 1] + 0.05 * inputs[k - 1, 0] + 0.001 * inputs[k - 1, 1] + 1.5 + 0.01 * rng.standard_normal()
    starts = np.zeros(count, dtype=np.bool_)
    starts[0] = True
    return Series(HOUR * np.arange(count), y[:, None], inputs, starts)


def test_the_regressors_are_those_of_a_textbook() -> None:
    record = lived_in()
    y, u, k, lead = record.outputs[:, 0], record.inputs, 60, 6
    expected = [y[k], y[k] - y[k - 1], y[k] - y[k - 1], y[k] - y[k - 6], y[k + lead - 24]]
    expected += [*u[k : k + 6].mean(axis=0), *u[k + 5 : k + 6].mean(axis=0), *u[k + 3 : k + 6].mean(axis=0)]
    past = [*u[k - 1 : k].mean(axis=0), *u[k - 6 : k].mean(axis=0), *u[k - 24 : k].mean(axis=0)]
    angle = 2 * np.pi * ((k + lead) % 24) / 24
    hour = [np.sin(angle), np.cos(angle)]
    found = regressors(record, HOUR, np.array([k]), lead, blind=False)[0]
    np.testing.assert_allclose(found, [*expected, *past, *hour], atol=1e-9)
    blind = regressors(record, HOUR, np.array([k]), lead, blind=True)[0]
    np.testing.assert_allclose(blind, [*expected[:5], *past, *hour], atol=1e-9)


def direct(name: str, record: Series) -> Forecasts:
    arrays = run_direct(PlainRun(name, record, HOUR, (1, 6), 1))
    return Forecasts(*(arrays[field] for field in Forecasts._fields))


def test_a_ridge_knows_nothing_of_what_comes_but_the_inputs() -> None:
    record = lived_in()
    later = record._replace(outputs=np.where(np.arange(len(record.times))[:, None] > 80, 30.0, record.outputs))
    np.testing.assert_array_equal(direct(RIDGE, record).mean[:81], direct(RIDGE, later).mean[:81])
    np.testing.assert_array_equal(direct(RIDGE, record).lower[:81], direct(RIDGE, later).lower[:81])
    warmer = record._replace(inputs=np.where(np.arange(len(record.times))[:, None] >= 80, 500.0, record.inputs))
    # Made at rows 70 to 76: for row 82 an input after row 80 counts, unless it may not be known.
    assert np.nanmax(np.abs(direct(RIDGE, record).mean[81:83, 1] - direct(RIDGE, warmer).mean[81:83, 1])) > 0.1
    made = slice(81, 86)
    np.testing.assert_array_equal(direct(BLIND, record).mean[made, 1], direct(BLIND, warmer).mean[made, 1])


def test_a_ridge_that_is_told_the_inputs_learns_a_linear_room() -> None:
    record = lived_in(12)
    errors = {
        name: np.nanmean(np.abs(direct(name, record).mean[200:, 1] - record.outputs[200:, 0]))
        for name in (RIDGE, BLIND)
    }
    assert errors[RIDGE] < 0.3 * errors[BLIND]


def test_boosting_forecasts_too() -> None:
    pytest.importorskip("lightgbm")
    record = lived_in(12)
    found = direct("boosting", record)
    still = np.abs(record.outputs[200:, 0] - record.outputs[194:-6, 0]).mean()
    assert np.nanmean(np.abs(found.mean[200:, 1] - record.outputs[200:, 0])) < 0.8 * still


def kept_warm(days: int = 4) -> Series:
    """An hourly record of a room whose thermostat keeps 21 degC by day and 17 at night, for hours that vary."""
    rng, count = np.random.default_rng(3), 24 * days
    hour, outdoor = np.arange(count) % 24, 4.0 + 3.0 * np.sin(np.arange(count) / 5.0)
    setpoints = np.where((hour >= 7) & (hour < 20 + rng.integers(0, 3, count)), 21.0, 17.0)
    y, heating = np.full(count, 18.0), np.zeros(count)
    for k in range(count):
        heating[k] = np.clip(1500.0 * (setpoints[k] - y[k]), 0.0, 3000.0)
        if k + 1 < count:
            y[k + 1] = y[k] + 0.1 * (outdoor[k] - y[k]) + 0.0012 * heating[k] + 0.02 * rng.standard_normal()
    starts = np.arange(count) == 0
    return Series(HOUR * np.arange(count), y[:, None], np.column_stack([outdoor, heating]), starts, setpoints)


def answered(question: str, record: Series) -> Forecasts:
    zone = FilterRun("mkf", {"particles": 8}, automatic(), HOUR, record, 1, leads=(1, 6))
    arrays = run_answered(AnsweredRun(question, zone))
    return Forecasts(*(arrays[field] for field in Forecasts._fields))


def test_a_zone_that_is_asked_knows_no_more_of_what_comes_than_the_question_says() -> None:
    record, row, target = kept_warm(), 84, 90
    later = np.arange(len(record.times)) > row
    colder = record._replace(
        outputs=np.where(later[:, None], 10.0, record.outputs),
        inputs=np.where(later[:, None], [-9.0, 0.0], record.inputs),
        setpoints=np.where(later, 12.0, record.setpoints),
    ).rows(slice(target + 1))
    live, scheduled = answered(LIVE, record), answered(SCHEDULED, record)
    np.testing.assert_array_equal(live.mean[: target + 1, 1], answered(LIVE, colder).mean[:, 1])
    assert answered(SCHEDULED, colder).mean[target, 1] < scheduled.mean[target, 1] - 0.5
    # Whoever knows the set-points to come forecasts best, once the law is known.
    known = np.isfinite(scheduled.crps[:, 1])
    assert known[target::2].all()
    assert scheduled.crps[known, 1].mean() < 0.8 * live.crps[known, 1].mean()


def test_a_room_without_set_points_is_not_asked_under_a_schedule() -> None:
    told = kept_warm(2)
    for record, runs in ((told, 1), (told._replace(setpoints=None), 0)):
        recording = Recording("room", "", True, automatic(), HOUR, record)
        assert len(list(jobs_of(named(SCHEDULED), recording, (1,)))) == runs
    config = ROOT / "deploy/examples/generic-csv.toml"
    with pytest.raises(ReplayError, match=r"--contender scheduled: no recording has a set-point; give the zone a"):
        prepare(Request(config=config, contender=(SCHEDULED,)))


def naive_crps(mixture: Mixture, value: float) -> float:
    """The integral of (F(x) - 1{x >= y})^2."""
    step = 3e-4
    x = value + step * (np.arange(-100_000, 100_000) + 0.5)
    below = np.zeros_like(x)
    for weight, mean, sd in zip(
        mixture.weights, mixture.means[0], np.broadcast_to(mixture.sds, mixture.means.shape)[0], strict=True
    ):
        below += weight * ndtr((x - mean) / sd)
    return float(((below - (x >= value)) ** 2).sum() * step)


# Of the MKF's 200 scenarios, 64 are scored: its distribution function is off by up to 1/64.
@pytest.mark.parametrize(("estimator", "options", "close"), [("ekf", {}, 1e-6), ("mkf", {"particles": 16}, 1 / 64)])
def test_a_run_is_what_a_naive_loop_finds(estimator: str, options: dict[str, object], close: float) -> None:
    network, record = PRESETS["building-67"], simulated_case(Request(days=2), 1).series
    leads = leads_of(PERIOD)
    run = FilterRun(estimator, options, network, PERIOD, record, 3, leads=tuple(leads.values()))
    arrays = run_hours(run)
    found = Forecasts(*(arrays[name] for name in Forecasts._fields))
    model = registry.build(estimator, network, PERIOD, options)
    state = model.start(3, record.outputs[0], record.inputs[0])
    state = model.predict(state, record.inputs[0])
    for k in range(1, 61):
        state = model.update(state, record.outputs[k]).state
        state = model.predict(state, record.inputs[k])
    later = list(model.unfold(model.issue(state, 200), record.inputs[61 : 60 + DAY_STEPS]).each())[1:]
    fan = [model.predictive(state), *later]
    for place, lead in enumerate(leads.values()):
        mixture, y = fan[lead - 1], record.outputs[60 + lead, 0]
        assert found.mean[60 + lead, place] == pytest.approx(mixture.mean()[0], rel=1e-12)
        assert found.crps[60 + lead, place] == pytest.approx(naive_crps(mixture, y), rel=close)
        below = float(mixture.weights @ ndtr((found.lower[60 + lead, place] - mixture.means[0]) / mixture.sds[0]))
        assert below == pytest.approx(0.025, abs=1e-6)
    begin = windows_of(record)[LATER].begin
    scores = figures(Recording("b", "", False, network, PERIOD, record), arrays)
    for place, (horizon, lead) in enumerate(leads.items()):
        errors, inside = [], []
        for k in range(begin, len(record.times)):
            target = k + lead
            if target < len(record.times) and (lead == 1 or k % 12 == 0):
                errors.append(found.mean[target, place] - record.outputs[target, 0])
                inside.append(found.lower[target, place] <= record.outputs[target, 0] <= found.upper[target, place])
        if errors:
            assert scores[key("forecasts scored", horizon)] == len(errors)
            assert scores[key("RMSE, K", horizon)] == pytest.approx(np.sqrt(np.mean(np.square(errors))))
            assert scores[key("largest error, K", horizon)] == pytest.approx(np.abs(errors).max())
            assert scores[key("coverage", horizon)] == pytest.approx(np.mean(inside))
        else:
            assert key("RMSE, K", horizon) not in scores


def test_a_network_with_known_heat_is_driven_as_in_the_daemon() -> None:
    network = with_known_heat(automatic(["T_i", "T_out", "u_heat"]), habits=True)
    record, where, leads = lived_in(3), Whereabouts(time_zone="Europe/Berlin"), (1, 6)
    options = {"members": {"habits": {"estimator": "mkf", "preset": "habits"}}}
    made = run_hours(FilterRun("bank", options, network, HOUR, record, 3, where, leads))
    drive = known_heat(network, HOUR, where).drive(record.times.astype(np.float64), record.inputs)
    model = registry.build("bank", network, HOUR, options)
    state = model.predict(model.start(3, record.outputs[0], drive[0]), drive[0])
    for k in range(1, 41):
        state = model.predict(model.update(state, record.outputs[k]).state, drive[k])
    fan = model.unfold(model.issue(state, 200), drive[41:46])
    assert [made["mean"][41, 0], made["mean"][46, 1]] == pytest.approx(
        [model.predictive(state).mean()[0], fan.at(-1).mean()[0]], rel=1e-9
    )


def test_the_first_days_hold_what_came_true_in_them() -> None:
    record = series([0.0] * 40)
    made = no_forecasts(40, 3)
    made.mean[:, 1] = made.crps[:, 1] = np.where(np.arange(40) < 4, np.nan, np.arange(40.0))
    found = figures(Recording("r", "", False, presets.network("tite"), 6 * HOUR, record), made._asdict())
    # Four steps of 6 h ahead, so the first target is row 4; three days end before row 12.
    assert found[key("forecasts scored", "24 h", FIRST_DAYS)] == 8
    assert found[key("largest error, K", "24 h", FIRST_DAYS)] == 11
    assert found[key("forecasts scored", "24 h", LATER)] == 40 - 12 - 4


def experiment(out: Path, *options: str) -> Path:
    assert main(["experiment", "hours-ahead", "--out", str(out), "--particles", "60", "--jobs", "1", *options]) == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    for heading in ("What was done", "Targets", "Which forecast is best?", "The first three days", "What to set"):
        assert heading in page
    assert "nan" not in page.split("</head>")[1].replace("nanm", "").lower().split("<script")[0]
    return out


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> Path:
    options = ["--days", "3", "--seeds", "1", "--recording", "building 67"]
    return experiment(tmp_path_factory.mktemp("hours"), *options)


def test_everybody_is_scored_at_every_horizon(building: Path) -> None:
    table = rows_of(building / "scores.csv")
    later = [row for row in table if row["window"] == LATER]
    labels = [contender.label for contender in contenders(Request())]
    assert labels[:4] == ["persistence", "yesterday", "ridge", "ridge-blind"]
    assert labels[-3:] == ["rbpf", "mkf", "bank"]
    assert [row["forecast"] for row in later] == labels * 4
    assert len({(row["ahead"], row["forecasts scored"]) for row in later}) == 4, "all on the same samples"
    assert all(float(row["CRPS, K"]) > 0 for row in later)
    assert {row["forecast"] for row in later if not row["coverage"]} == {"persistence", "yesterday"}
    assert {row["forecast"] for row in table if row["window"] == FIRST_DAYS} == set(labels)


def test_verdicts_follow_from_the_numbers(building: Path) -> None:
    crps = {row["ahead"]: row for row in rows_of(building / "crps-after-three-days.csv")}
    coverage = {row["ahead"]: float(row["bank"]) for row in rows_of(building / "coverage-after-three-days.csv")}
    targets = {row["target"]: row for row in rows_of(building / "verdicts.csv")}
    ratios = {}
    for ahead, row in crps.items():
        others = {
            name: float(value)
            for name, value in row.items()
            if value and name not in ("recording", "ahead", "bank") and not name.endswith("(sd)")
        }
        best = min(others, key=others.__getitem__)
        ratios[ahead] = float(row["bank"]) / others[best]
        verdict = targets[f"building 67, {ahead}: CRPS of the bank over that of the best other forecast, {best}"]
        assert float(verdict["found (mean ± sd over seeds)"]) == pytest.approx(ratios[ahead])
        assert verdict["verdict"] == ("met" if ratios[ahead] <= OVER_BEST else "missed")
        covered = targets[f"building 67, {ahead}: coverage of the bank"]["verdict"]
        assert covered == ("met" if COVERED[0] <= coverage[ahead] <= COVERED[1] else "missed")
    average = targets["6 h: CRPS of the bank over that of the best other forecast, geometric mean over recordings"]
    assert float(average["found (mean ± sd over seeds)"]) == pytest.approx(ratios["6 h"])


def test_a_configuration_brings_its_recording(tmp_path: Path) -> None:
    config = str(ROOT / "deploy/examples/generic-csv.toml")
    few = [word for name in ("persistence", "mkf:particles=16", "bank", "planned") for word in ("--contender", name)]
    table = rows_of(experiment(tmp_path, "--config", config, "--seeds", "2", *few) / "crps-after-three-days.csv")
    assert [row["ahead"] for row in table] == ["1 step", "1 h", "6 h"], "two days are too short for 24 h"
    assert {row["recording"] for row in table} == {"room-1"}
    assert all(float(row["mkf:particles=16"]) > 0 for row in table)
    assert all(row["bank (sd)"] for row in table), "two seeds"
    assert [row["planned"] == row["bank"] for row in table] == [True, False, False], "hours ahead others answer"


def test_a_zone_that_leaves_its_estimator_as_it_is_adds_no_contender() -> None:
    config = ROOT / "deploy/examples/generic-csv.toml"
    labels = [contender.label for contender in contenders(Request())]
    for settings, added in (((), []), (("zones.room-1.estimator_options={particles=64}",), ["as configured (rbpf)"])):
        found = contenders(Request(config=config, overrides=("zones.room-1.estimator='rbpf'", *settings)))
        assert [contender.label for contender in found] == labels + added
    assert [contender.label for contender in contenders(Request(config=config))] == labels


def test_a_contender_is_named_with_its_options() -> None:
    plain, given = contenders(Request(contender=("ridge", "mkf:particles=64,preset='default'"), particles=500))
    assert (plain.estimator, seeded(plain)) == ("ridge", False)
    assert (given.estimator, given.options, seeded(given)) == ("mkf", {"particles": 64, "preset": "default"}, True)
    (fewer,) = contenders(Request(contender=("rbpf",), particles=500))
    assert fewer.options == {"particles": 500}
    for text, said in (
        ("rigde", "there is no 'rigde'; the contenders are persistence, yesterday, ridge"),
        ("ridge:penalty=3", "ridge has no options"),
        ("mkf:particles=", "the options are not TOML"),
    ):
        with pytest.raises(ReplayError, match=said):
            contenders(Request(contender=(text,)))


def read(name: str) -> Recording:
    found = RECORDINGS[name](DATA)
    assert found is not None
    return found


@measured
@tabled
def test_measured_recordings_are_read(name: str, samples: int, period: int, inputs: list[str]) -> None:
    recording = read(name)
    assert (len(recording.series.times), recording.period) == (samples, period)
    assert list(recording.network.inputs) == inputs
    assert recording.measured == (name != "building 67")
    limits = {"T_out": (-30, 45), "u_heat": (0, 2e5), "I_sol": (0, 1200)}
    limits |= {f"T_adj_{room}": (-10, 45) for room in ("attic", "cellar", "corridor")}
    for channel, values in zip(inputs, recording.series.inputs.T, strict=True):
        low, high = limits[channel]
        assert low - 20 <= values.min() <= values.max() <= high, channel


@measured
def test_a_flat_without_power_is_bridged() -> None:
    recording = read("flat Room1")
    series, inputs = recording.series, recording.network.inputs
    assert inputs == ("T_out", "u_heat")
    assert not series.inputs[:, inputs.index("u_heat")].any()
    assert np.isfinite(series.inputs).all()
    assert 0.85 * 8557 < np.isfinite(series.outputs).sum() < 8557
    assert series.starts.sum() < 200
