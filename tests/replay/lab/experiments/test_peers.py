"""Measured buildings that others have fitted; the data are not part of the project."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest

from estimator.offline.least_squares import fit_open_loop
from replay.errors import ReplayError
from replay.lab.experiments.peers import experiment as peers
from replay.lab.experiments.peers.data import ARMADILLO, Case, cases, flexhouse_network
from replay.lab.experiments.peers.scores import open_loop, persistence, published_parameters, scored_rows, train_segment
from service.cli.main import main

DATA = Path(__file__).parents[5] / "shared" / "data"
measured = pytest.mark.skipif(not DATA.is_dir(), reason="the measured data are not beside the project")


def case(name: str) -> Case:
    return next(entry for entry in cases(DATA) if entry.name == name)


@measured
def test_every_folder_is_read_with_its_split() -> None:
    found = {entry.name: (len(entry.series.times), entry.train, entry.period) for entry in cases(DATA)}
    assert found == {
        "darkgreybox demo": (792, 672, 3600),
        ARMADILLO: (232, 232, 1800),
        "armadillo, last third held out": (232, 155, 1800),
        "FlexHouse PRBS1": (1691, 1152, 300),
    }


@measured
def test_darkgreybox_is_met_on_both_parts_of_its_split() -> None:
    """Published: .3719 K and .3383 K. Hidden nodes enter the test part as the measurements have led them."""
    data = case("darkgreybox demo")
    fit = fit_open_loop(data.network, data.period, [train_segment(data)], starts=6)
    found = open_loop(data, fit.theta, fit.initial_states[0])
    assert found.train_rmse == pytest.approx(fit.rmse, rel=1e-9)
    assert found.train_rmse < 0.372
    assert found.test_rmse < 0.338
    again = open_loop(data, fit.theta)
    assert again.train_rmse == pytest.approx(found.train_rmse, rel=1e-2)


@measured
def test_the_published_armadillo_parameters_simulate_as_published_with_linear_inputs() -> None:
    """Published: RMSE .7434 K, MAE .6579 K."""
    held, linear = published_parameters(case(ARMADILLO)).values()
    assert linear.train_rmse == pytest.approx(0.7434, rel=0.03)
    assert linear.train_mae == pytest.approx(0.6579, rel=0.05)
    assert held.train_rmse > linear.train_rmse


@measured
def test_persistence_and_the_rows_that_count() -> None:
    data = case(ARMADILLO)
    assert scored_rows(data).start == 48
    y = data.series.outputs[:, 0]
    assert persistence(data).rmse == pytest.approx(np.sqrt(np.mean((y[48:] - y[47:-1]) ** 2)))
    assert scored_rows(case("FlexHouse PRBS1")).start == 1152


@measured
def test_the_experiment_in_short(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peers, "STARTS", 3)
    shutil.copytree(DATA / "armadillo", tmp_path / "data" / "armadillo")
    options = ["--data", str(tmp_path / "data"), "--particles", "60", "--seeds", "2", "--jobs", "1"]
    assert main(["experiment", "peers", "--out", str(tmp_path / "out"), *options]) == 0
    with (tmp_path / "out" / "open-loop.csv").open(newline="") as file:
        rows = {row["estimator"]: row for row in csv.DictReader(file) if row["recording"] in (ARMADILLO, "")}
    assert float(rows["least squares"]["train RMSE"]) == pytest.approx(0.245, abs=0.01)
    assert set(peers.CONTENDERS) < set(rows)
    assert any(name.startswith("pySIP") and row["train RMSE"] == "0.7434" for name, row in rows.items())
    with (tmp_path / "out" / "one-step.csv").open(newline="") as file:
        ahead = {row["estimator"]: row for row in csv.DictReader(file) if row["recording"] in (ARMADILLO, "")}
    still = float(ahead[f"nothing changes ({ARMADILLO})"]["RMSE [K]"])
    assert float(ahead["UKF, box around the fit"]["RMSE [K]"]) < still
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "why our figure is another" in page


def test_without_data_it_says_what_it_needs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = ["--out", str(tmp_path)]
    assert main(["experiment", "peers", *out]) == 1
    assert "name the folder that holds them with --data" in capsys.readouterr().err
    assert main(["experiment", "peers", *out, "--data", str(tmp_path)]) == 1
    assert "it holds none of darkgreybox_demo/demo_data.csv" in capsys.readouterr().err
    assert main(["experiment", "peers", *out, "--data", str(tmp_path / "none")]) == 1
    assert "there is no such folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Time,T_ext,T_int\n0,1,2\n", "column 'P_hea' is missing"),
        ("T_ext,P_hea,T_int\n1,x,2\n1,1,2\n", "a cell is not a number"),
        ("T_ext,P_hea,T_int\n", "it is empty or has gaps"),
    ],
)
def test_another_file_under_the_name_is_refused(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "armadillo").mkdir()
    (tmp_path / "armadillo" / "armadillo_data_H2.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ReplayError, match=said):
        cases(tmp_path)


def test_the_flexhouse_network_is_titethts() -> None:
    network = flexhouse_network()
    assert network.nodes == ("T_s", "T_i", "T_e", "T_h")
    assert network.channels == ("T_s", "T_out", "u_heat", "I_sol")
