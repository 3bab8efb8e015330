"""Forecasts of the hours ahead: their scores against naive ones, and the experiment in short."""

from __future__ import annotations

import asyncio
import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr

from estimator import registry
from estimator.network.presets import building_67
from estimator.types import Mixture
from replay.experiments.hours_ahead import recordings as catalogue
from replay.experiments.hours_ahead import runs
from replay.experiments.hours_ahead.forecasts import PERSISTENCE, PREVIOUS_DAY, Forecasts, point_forecasts
from replay.experiments.hours_ahead.horizons import SHARE, THREE_DAYS, issued, leads_of, scored_from
from replay.experiments.hours_ahead.recordings import ARMADILLO, DARKGREYBOX, FLEXHOUSE, RECORDINGS, Recording
from replay.experiments.hours_ahead.rivals import rivals
from replay.experiments.hours_ahead.runs import HoursRun, run_hours
from replay.experiments.hours_ahead.scores import overlapping, score
from replay.experiments.hours_ahead.verdicts import COVERAGE, OVER_BEST
from replay.experiments.request import Request
from replay.experiments.semi_synthetic.case import simulated_case
from replay.experiments.series.filtering import FilterRun, Series
from replay.experiments.series.recorded import samples_of
from replay.experiments.series.recorded_zone import bridged, read_zone
from replay.localtime import DAY, HOUR
from replay.simulated.semi_synthetic import PERIOD
from service.cli.main import main
from service.config.fitting import make_worker
from service.config.load import load

ROOT = Path(__file__).parents[3]
DATA = ROOT.parent / "shared" / "data"
measured = pytest.mark.skipif(not DATA.is_dir(), reason="the measured data are not beside the project")
DAY_STEPS = DAY // PERIOD


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


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


def test_scoring_begins_after_three_days_or_in_the_middle_of_a_short_record() -> None:
    assert scored_from(series([0.0] * 40)) == {THREE_DAYS: 12, SHARE: 12}
    assert scored_from(series([0.0] * 14)) == {THREE_DAYS: 7, SHARE: 4}


def test_persistence_and_the_previous_day_are_exact() -> None:
    y = [1.0, 2.0, 4.0, 8.0, np.nan, 32.0, 64.0, 128.0, 256.0, 512.0]
    made = point_forecasts(series(y), 6 * HOUR, (1, 4))
    still, day_before = made[PERSISTENCE].mean, made[PREVIOUS_DAY].mean
    np.testing.assert_array_equal(still[:, 0], [np.nan, 1, 2, 4, 8, 8, 32, 64, 128, 256])
    np.testing.assert_array_equal(still[:, 1], [np.nan] * 4 + [1, 2, 4, 8, 8, 32])
    # Four steps before; the last value where the record does not reach back, the one before where nothing was measured.
    np.testing.assert_array_equal(day_before[:, 0], [np.nan, 1, 2, 4, 1, 2, 4, 8, 8, 32])
    np.testing.assert_array_equal(day_before[:, 1], still[:, 1])
    np.testing.assert_array_equal(made[PERSISTENCE].crps[5:8, 0], [24, 32, 64])
    assert np.isnan(made[PERSISTENCE].crps[4, 0])
    assert np.isnan(made[PERSISTENCE].lower).all()


def test_the_previous_day_looks_across_a_gap() -> None:
    made = point_forecasts(series([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], (0, 4)), 6 * HOUR, (1,))
    # Rows 5 and 6 are 24 h after rows 2 and 3, for the gap has taken one interval.
    np.testing.assert_array_equal(made[PREVIOUS_DAY].mean[:, 0], [np.nan, 1, 2, 3, np.nan, 3, 4])


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
    network, record = building_67(), simulated_case(building_67(), Request(days=2), 1).series
    leads = leads_of(PERIOD)
    run = HoursRun(FilterRun(estimator, options, network, PERIOD, record, 3), tuple(leads.values()))
    arrays = run_hours(run, lambda steps: None)
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
    assert arrays["parameters"].shape == (10, 3)

    scores = score(record.outputs[:, 0], found, leads, 100)
    for place, (horizon, lead) in enumerate(leads.items()):
        errors, inside = [], []
        for k in range(100, len(record.times)):
            target = k + lead
            if target < len(record.times) and (lead == 1 or k % 12 == 0):
                errors.append(found.mean[target, place] - record.outputs[target, 0])
                inside.append(found.lower[target, place] <= record.outputs[target, 0] <= found.upper[target, place])
        assert scores[horizon].samples == len(errors)
        assert scores[horizon].rmse == pytest.approx(np.sqrt(np.mean(np.square(errors))))
        assert scores[horizon].coverage == pytest.approx(np.mean(inside))


def test_intervals_of_seeds_overlap_or_not() -> None:
    seeds = np.array([[[0.0, 2.0], [0.0, 1.0]], [[1.0, 3.0], [0.5, 2.0]], [[1.5, 4.0], [1.5, 3.0]]])
    assert overlapping(seeds).tolist() == [True, False]


def test_a_recording_is_bridged_as_the_worker_bridges_it() -> None:
    settings = ["zones.living.estimator='arx'", "zones.living.estimator_options={}"]
    settings += ["zones.living.max_gap=2", "zones.living.hold_inputs='10min'"]
    config = load(ROOT / "deploy/examples/ecolar.toml", settings)
    zone = config.zones[0]
    worker, updates = make_worker(zone), []
    for sample in asyncio.run(samples_of(config, zone)):
        update = worker.step(sample)
        if update is not None:
            updates.append(update)
    record = bridged(read_zone(config, zone), zone.network, zone.max_gap)
    assert record.times.tolist() == [update.time for update in updates]
    assert np.cumsum(record.starts).tolist() == [update.segment for update in updates]


@pytest.fixture(scope="module")
def short() -> Iterator[pytest.MonkeyPatch]:
    """One simulated recording, and one start of the fit."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(catalogue, "RECORDINGS", {"building 67": RECORDINGS["building 67"]})
        patch.setattr(runs, "STARTS", 1)
        yield patch


def experiment(out: Path, *options: str) -> Path:
    assert main(["experiment", "hours-ahead", "--out", str(out), "--particles", "60", "--jobs", "1", *options]) == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    for heading in ("What was done", "Targets", "Which forecast is best?", "What to set"):
        assert heading in page
    assert "nan" not in page.split("</head>")[1].replace("nanm", "").lower().split("<script")[0]
    return out


@pytest.fixture(scope="module")
def building(short: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return experiment(tmp_path_factory.mktemp("hours"), "--days", "3", "--seeds", "1")


def test_everybody_is_scored_at_every_horizon(building: Path) -> None:
    table = rows(building / "scores-building-67-after-three-days.csv")
    labels = ["persistence", "previous day", "least squares", "ARX", "daily", "EKF", "UKF"]
    labels += ["RBPF paper", "RBPF default", "MKF", "bank"]
    assert [row["forecast"] for row in table] == labels * 4
    assert len({(row["ahead"], row["forecasts scored"]) for row in table}) == 4, "all on the same samples"
    assert all(float(row["CRPS, K"]) > 0 for row in table)
    assert {row["forecast"] for row in table if not row["coverage"]} == {"persistence", "previous day"}


def test_verdicts_follow_from_the_numbers(building: Path) -> None:
    crps = {row["ahead"]: row for row in rows(building / "crps-after-three-days.csv")}
    coverage = {row["ahead"]: float(row["bank"]) for row in rows(building / "coverage-after-three-days.csv")}
    targets = {row["target"]: row for row in rows(building / "verdicts.csv")}
    for ahead, row in crps.items():
        others = {
            name: float(value)
            for name, value in row.items()
            if value and name not in ("recording", "ahead", "bank") and not name.endswith("(sd)")
        }
        best = min(others, key=others.__getitem__)
        ratio = float(row["bank"]) / others[best]
        verdict = targets[f"building 67, {ahead}: CRPS of the bank over that of the best rival, {best}"]
        assert float(verdict["found (mean ± sd over seeds)"]) == pytest.approx(ratio)
        assert verdict["verdict"] == ("met" if ratio <= OVER_BEST else "missed")
        covered = targets[f"building 67, {ahead}: coverage of the bank"]["verdict"]
        assert covered == ("met" if COVERAGE[0] <= coverage[ahead] <= COVERAGE[1] else "missed")
    ratio = float(crps["6 h"]["bank"]) / float(crps["6 h"]["RBPF default"])
    verdict = targets["6 h: CRPS of the bank over that of RBPF default, mean over recordings"]
    assert float(verdict["found (mean ± sd over seeds)"]) == pytest.approx(ratio)
    assert all(row["verdict"] == "open" for name, row in targets.items() if "seeds" in name or "measured" in name)


def test_a_finished_run_only_writes_its_report_again(building: Path, short: pytest.MonkeyPatch) -> None:
    files = {path: path.stat().st_mtime_ns for path in (building / "runs").iterdir()}
    experiment(building, "--days", "3", "--seeds", "1")
    assert {path: path.stat().st_mtime_ns for path in (building / "runs").iterdir()} == files


def test_a_configuration_brings_its_recording_and_its_estimator(short: pytest.MonkeyPatch, tmp_path: Path) -> None:
    config = str(ROOT / "deploy/examples/generic-csv.toml")
    own = ["--set", "zones.room-1.estimator='mkf'", "--set", "zones.room-1.estimator_options={particles=16}"]
    out = experiment(tmp_path, "--config", config, "--seeds", "2", *own)
    table = rows(out / "crps-after-three-days.csv")
    assert [row["ahead"] for row in table] == ["1 step", "1 h", "6 h"], "two days are too short for 24 h"
    assert {row["recording"] for row in table} == {"room-1"}
    assert all(float(row["as configured (mkf)"]) > 0 for row in table)
    assert {row["estimator"] for row in rows(out / "seeds.csv")} >= {"bank", "MKF", "as configured (mkf)"}
    targets = {row["target"]: row["verdict"] for row in rows(out / "verdicts.csv")}
    assert targets["room-1: CRPS of the bank, sd over seeds as a share of the mean, worst horizon"] != "open"
    assert targets["room-1, 24 h: coverage of the bank"] == "open"


def test_a_zone_that_leaves_its_estimator_as_it_is_adds_no_rival() -> None:
    config = ROOT / "deploy/examples/generic-csv.toml"
    labels = [rival.label for rival in rivals(Request())]
    for settings, added in (((), []), (("zones.room-1.estimator_options={particles=64}",), ["as configured (rbpf)"])):
        found = rivals(Request(config=config, overrides=("zones.room-1.estimator='rbpf'", *settings)))
        assert [rival.label for rival in found] == labels + added
    assert [rival.label for rival in rivals(Request(config=config))] == labels


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--data", "."], "it holds none of flexhouse_prbs1/inputPRBS1.csv"),
        (["--data", ".", "--config", "x.toml"], "give one of the two"),
        (["--network", "tite"], "--network means nothing to this experiment"),
    ],
)
def test_mistakes_are_one_sentence(
    options: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["experiment", "hours-ahead", *options]) in (1, 2)
    assert said in capsys.readouterr().err


def read(name: str) -> Recording:
    found = RECORDINGS[name](DATA)
    assert found is not None
    return found


def test_what_is_not_at_hand_is_left_out(tmp_path: Path) -> None:
    assert [RECORDINGS[name](tmp_path) for name in ("FlexHouse", "darkgreybox demo", "armadillo")] == [None] * 3
    assert RECORDINGS["FlexHouse"](None) is None


@measured
@pytest.mark.parametrize(
    ("name", "samples", "period", "inputs"),
    [
        ("FlexHouse", 1691, 300, ("T_out", "u_heat", "I_sol")),
        ("darkgreybox demo", 792, 3600, ("T_out", "u_heat")),
        ("armadillo", 232, 1800, ("T_out", "u_heat", "I_sol")),
        ("building 67", 22_176, 600, ("T_out", "u_heat", "I_sol")),
    ],
)
def test_measured_recordings_are_read(name: str, samples: int, period: int, inputs: tuple[str, ...]) -> None:
    recording = read(name)
    assert (len(recording.series.times), recording.period, recording.network.inputs) == (samples, period, inputs)
    assert recording.measured == (name != "building 67")
    limits = {"T_out": (-30, 45), "u_heat": (0, 2e5), "I_sol": (0, 1200)}
    for channel, values in zip(inputs, recording.series.inputs.T, strict=True):
        low, high = limits[channel]
        assert low - 20 <= values.min() <= values.max() <= high, channel


@measured
def test_the_files_are_where_the_folder_has_them() -> None:
    assert all((DATA / path).exists() for path in (FLEXHOUSE, DARKGREYBOX, ARMADILLO))
