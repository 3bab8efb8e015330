"""What every experiment rests on: the loop over a series, recordings as series, nights, scores of a run."""

from pathlib import Path

import numpy as np
import pytest
from support.tables import rows_of

from estimator.network.presets import PRESETS
from replay.experiments.hours_ahead.recordings import of_zone
from replay.experiments.request import Request
from replay.experiments.series.filtering import FilterRun, Trace, run_filter
from replay.lab.experiments.semi_synthetic.building import DOMINATED, figures, key, simulated_case, since_change
from replay.recorded.tables import utc_stamps
from replay.simulated.semi_synthetic import MEASUREMENT_NOISE_SD, PERIOD, PROCESS_NOISE_SD
from service.cli.main import main
from service.config.load import load

ECOLAR = Path(__file__).parents[3] / "deploy/examples/ecolar.toml"


def test_the_loop_says_what_the_zone_worker_publishes(tmp_path: Path) -> None:
    settings = ["zones.living.estimator_options.particles=60", "zones.living.seed=3"]
    # Gaps are bridged in the same way, whatever the zone says of them.
    settings += ["zones.living.max_gap=2", "zones.living.hold_inputs='10min'"]
    overrides = [word for setting in settings for word in ("--set", setting)]
    assert main(["replay", str(ECOLAR), "--out", str(tmp_path), *overrides]) == 0
    rows = rows_of(tmp_path / "living" / "updates.csv")
    config = load(ECOLAR, settings)
    zone = config.zones[0]
    series = of_zone(config, zone).series
    trace = Trace(**run_filter(FilterRun("rbpf", zone.estimator_options, zone.network, zone.period, series, 3)))
    assert [row["time"] for row in rows] == utc_stamps(series.times)
    assert sum(series.starts) == len({row["segment"] for row in rows}) > 1
    for name in ("mean", "lower", "upper", "gate"):
        published = np.array([float(row[name] or "nan") for row in rows])
        np.testing.assert_array_equal(getattr(trace, name), published)


def test_scores_of_the_floor_are_those_of_someone_who_knows_everything() -> None:
    network, case = PRESETS["building-67"], simulated_case(Request(days=12), 4)
    options = {"process_sd": PROCESS_NOISE_SD, "measurement_sd": MEASUREMENT_NOISE_SD}
    scores = figures(case, Trace(**run_filter(FilterRun("floor", options, network, PERIOD, case.series, 4))))
    assert [scores[f"H2 {name}"] for name in ("solar", "heater", "outside")] == [0.0, 0.0, 0.0]
    assert np.isnan(scores["parasitic-learning index"]), "nothing moves, so there is no index"
    # The gain is ignored here: quiet steps are covered, disturbed ones are not.
    assert scores[key("one_step", "coverage", DOMINATED)] < 0.3 < 0.8 < scores[key("one_step", "coverage")]
    assert scores[key("one_step", "width, K")] == pytest.approx(0.640, abs=0.003)
    assert scores[key("filtered", "width, K")] == pytest.approx(0.231, abs=0.003)
    assert scores["open loop, smallest"] > 0


@pytest.mark.parametrize(
    ("estimator", "options"),
    [("mkf", {"particles": 16}), ("mkf", {"particles": 16, "measurement_sd": 0.15}), ("arx", {})],
)
def test_the_filtered_convention_leaves_out_a_noise_that_is_known(estimator: str, options: dict[str, object]) -> None:
    run = FilterRun(estimator, options, PRESETS["building-67"], PERIOD, simulated_case(Request(days=1), 1).series, 1)
    trace = Trace(**run_filter(run))
    assert np.isfinite(trace.mean[1:]).all()
    if estimator == "arx":
        assert np.isnan(trace.filtered_mean).all()
    else:
        assert (trace.filtered_upper - trace.filtered_lower < trace.upper - trace.lower)[20:].mean() > 0.9


def test_steps_since_the_label_changed() -> None:
    dominated = np.array([False, False, True, True, True, False])
    assert since_change(dominated)[2:].tolist() == [0, 1, 2, 0]
    assert (since_change(dominated)[:2] > 6).all()
