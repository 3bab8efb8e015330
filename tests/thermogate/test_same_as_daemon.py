"""What `fit` computes is what `thermogate replay` writes of the same data, bit for bit."""

import json
from contextlib import nullcontext
from typing import Any

import numpy as np
import pandas as pd
import pytest
from support.harness import EXAMPLES, overrides
from support.tables import rows_of

import thermogate as tg
from service.cli.main import main

FIELDS = {"y": "y", "mean": "mean", "lower_0.95": "lower", "upper_0.95": "upper", "sd": "sd", "residual": "residual"}


def numbers(rows, name):
    return np.array([float(row[name] or "nan") for row in rows])


def assert_the_same(model, updates, parameters, summary):
    found = model.predictions
    assert [when.strftime("%Y-%m-%dT%H:%M:%SZ") for when in found.index.tz_convert("UTC")] == [
        row["time"] for row in updates
    ]
    for own, theirs in FIELDS.items():
        assert found[own].to_numpy().tobytes() == numbers(updates, theirs).tobytes(), own
    assert found["segment"].tolist() == numbers(updates, "segment").tolist()
    for own in ("lower", "median", "upper"):
        assert model.volatility[own].to_numpy().tobytes() == numbers(updates, f"alpha_{own}").tobytes()
    assert model.gate["gate"].to_numpy().tobytes() == numbers(updates, "gate").tobytes()
    for name in model.parameter_history:
        assert model.parameter_history[name].to_numpy().tobytes() == numbers(parameters, name).tobytes()
    assert model.faults == summary["faults"]
    quantiles = model.parameters([0.025, 0.5, 0.975])
    for name, row in summary["parameters"].items():
        told = [None if np.isnan(value) else value for value in quantiles.loc[name, ["q0.025", "q0.5", "q0.975"]]]
        assert told == [row["q0.025"], row["q0.5"], row["q0.975"]]
    assert model.findings.to_dict("records") == summary["findings"]
    skill = model.skill()
    for name, one in zip(skill.index, summary["skill"].values(), strict=True):
        assert skill.loc[name, "forecasts"] == one["forecasts"]
        for score in ("coverage", "crps", "rmse", "width"):
            assert skill.loc[name, score] == pytest.approx(one[score] or np.nan, rel=0, abs=0, nan_ok=True)


def test_a_raw_log_with_a_gap_missing_cells_and_late_rows(tmp_path):
    """Its times are local, and its heating is the sum of five columns."""
    settings: dict[str, object] = {"zones.0.estimator_options.particles": 64, "zones.0.seed": 0}
    assert main(["replay", str(EXAMPLES / "ecolar.toml"), "--out", str(tmp_path), *overrides(settings)]) == 0
    ((zone, summary),) = json.loads((tmp_path / "summary.json").read_text())["zones"].items()
    updates, parameters = (rows_of(tmp_path / zone / f"{name}.csv") for name in ("updates", "parameters"))
    assert summary["segments"] > 1
    frame = pd.read_csv(EXAMPLES / "data" / "ecolar-standin.csv.gz", index_col="Timestamp")
    assert frame.isna().to_numpy().any()
    frame.index = pd.to_datetime(frame.index)
    assert not frame.index.is_monotonic_increasing
    circuits = ["my-pv1", "my-pv2", "my-pv3", "Relay 4", "Relay 5"]
    columns = {
        "T_air": "Temp2",
        "T_out": "Sensor_outside",
        "T_adj": "Other_room_temp",
        "u_heat": {"columns": circuits, "unit": "kW", "aggregate": "first", "valid": [0, 20000]},
    }
    options = {"preset": "paper", "particles": 64}
    arguments: dict[str, Any] = {"tz": "Europe/Berlin", "columns": columns, "estimator_options": options}
    arguments |= {"period": "5min", "max_gap": 0, "hold_inputs": 0}
    with pytest.warns(UserWarning, match="not used") if summary["faults"] else nullcontext():
        model = tg.fit(frame, "ecolar-6r4c", **arguments)
    assert_the_same(model, updates, parameters, summary)
