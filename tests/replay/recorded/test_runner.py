"""`thermogate replay`: rows, seeds, bounds in time, and the mistakes it explains."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from support.tables import rows_of

from replay.recorded.runner import replay_recording
from replay.scores.intervals import coverage, winkler
from service.config.load import load
from service.errors import ServiceError
from service.recordings import progress

EXAMPLE = Path(__file__).parents[3] / "deploy" / "examples" / "building-67.toml"
ZONE = "building-67"


def config(*settings):
    return load(EXAMPLE, ["zones.0.estimator_options.particles=200", *settings])


def replay(out, *settings, **options):
    arguments = {"zone": None, "seed": None, "start": None, "end": None, "progress": False} | options
    assert [trace.zone for trace in replay_recording(config(*settings), out, **arguments)] == [ZONE]
    return rows_of(out / ZONE / "updates.csv"), json.loads((out / "summary.json").read_text())["zones"][ZONE]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    out = tmp_path_factory.mktemp("whole")
    return out, *replay(out)


def test_the_rows_are_the_ones_the_summary_scores(whole):
    out, rows, summary = whole
    assert ",".join(rows[0]) == (
        "time,y,mean,lower,upper,sd,residual,alpha_lower,alpha_median,alpha_upper,cdf,gate,n_eff,resampled,"
        "log_likelihood,segment,gain_lower,gain_median,gain_upper,setpoint"
    )
    assert len(rows) == summary["samples"] == 432
    y, lower, upper = (np.array([float(row[name] or "nan") for row in rows]) for name in ("y", "lower", "upper"))
    assert math.isnan(lower[0])
    assert summary["coverage"] == coverage(y, lower, upper)
    assert summary["winkler_K"] == winkler(y, lower, upper, 0.95)
    assert summary["scored"] == 431
    assert summary["after_first_day"]["scored"] == 432 - 144
    parameters = rows_of(out / ZONE / "parameters.csv")
    assert [row["time"] for row in parameters] == [row["time"] for row in rows]
    assert list(parameters[0])[1:] == list(summary["parameters"])


def test_what_the_model_does_not_know_is_printed_and_in_the_summary(tmp_path, capsys):
    box = 'zones.0.network={preset="building-67", parameters={g_e_out={lower=10, upper=20}}}'
    _, summary = replay(tmp_path, box, 'zones.0.estimator="ekf"', "zones.0.estimator_options={}")
    found = summary["findings"]
    assert {"parameter-at-bound", "parameter-not-identified"} == {finding["finding"] for finding in found}
    printed = capsys.readouterr().out.splitlines()
    assert printed == [f"zone '{ZONE}': {each['finding']} ({each['subject']}): {each['sentence']}" for each in found]


def test_the_same_seed_gives_the_same_file_and_another_seed_another(whole, tmp_path):
    out, rows, summary = whole
    again, _ = replay(tmp_path / "again")
    other, _ = replay(tmp_path / "other", seed=1)
    assert again == rows
    assert other[-1]["mean"] != rows[-1]["mean"]
    assert (tmp_path / "again" / ZONE / "updates.csv").read_bytes() == (out / ZONE / "updates.csv").read_bytes()
    assert summary["seed"] != 1


def test_start_and_end_bound_the_samples(whole, tmp_path):
    _, rows, _ = whole
    begin, end = 1712793600.0, 1712880000.0  # 11 April 2024, a whole day UTC
    part, summary = replay(tmp_path, start=begin, end=end)
    assert [row["time"] for row in part] == [row["time"] for row in rows if "04-11T" in row["time"]]
    assert summary["samples"] == 144


def test_a_time_without_recording_is_said(tmp_path):
    (tmp_path / "summary.json").write_text("{}")
    with pytest.raises(ServiceError, match=r"no usable sample in the recording between --start and --end$"):
        replay(tmp_path, start=4e9)
    assert not (tmp_path / "summary.json").exists(), "no scores of an earlier replay are left beside it"


def test_a_recording_whose_every_cell_is_refused_says_so(tmp_path):
    with pytest.raises(ServiceError, match=r"no usable sample in the recording; refused: \d+ bad_timestamp; look at"):
        replay(tmp_path, 'sources.simulation.timestamp.format="%m/%d/%Y"')


def test_an_output_folder_that_cannot_be_made_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ServiceError, match="cannot be written"):
        replay(tmp_path / "file" / "out")


def test_the_progress_has_an_end(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(progress, "SLOW", 0.0)
    replay(tmp_path, end=1712793600.0, progress=True)
    shown = capsys.readouterr().err
    assert "reading: 432 samples" in shown
    assert "replay: 100%" in shown
    assert "144/144" in shown
