"""Zones with `estimator = "ekf"` and `"ukf"`, from recording to REST and Zenoh, beside each other in one daemon."""

import csv
import json

import numpy as np
import pytest
import zenoh
from support.harness import EXAMPLES, Daemon, free_port, overrides, thermogate

CONFIG = EXAMPLES / "building-67.toml"
ZONE = "building-67"


def replay(out, estimator):
    done = thermogate("replay", CONFIG, "--out", out, *overrides({f"zones.{ZONE}.estimator": estimator}))
    assert done.returncode == 0, done.stderr
    with (out / ZONE / "updates.csv").open() as file:
        rows = list(csv.DictReader(file))
    return rows, json.loads((out / "summary.json").read_text())["zones"][ZONE]


@pytest.mark.parametrize("estimator", ["ekf", "ukf"])
def test_replay_and_daemon_agree(estimator, tmp_path):
    rows, summary = replay(tmp_path / "replay", estimator)
    assert summary["settings"]["estimator"] == estimator
    assert summary["settings"]["options"]["parameter_sd"] == 0.01
    assert 0.5 < summary["coverage"] < 1
    assert {row["alpha_median"] for row in rows} == {""}
    assert {row["gate"] for row in rows[1:]} == {"1.0"}
    quantiles = summary["parameters"]["C_i"]
    # The upper ones meet where the estimate lies at the edge of its box.
    assert quantiles["q0.025"] < quantiles["q0.5"] <= quantiles["q0.975"]

    port = free_port()
    live = {
        f"zones.{ZONE}.estimator": estimator,
        "site.state_dir": str(tmp_path / "state"),
        "zenoh.enabled": True,
        "zenoh.listen": [f"tcp/127.0.0.1:{port}"],
    }
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    with Daemon(CONFIG, tmp_path / "log", live) as daemon:
        daemon.wait_until_ended()
        status, forecast = daemon.get(f"/zones/{ZONE}/forecast?level=0.5&level=0.95")
        assert (status, forecast["volatility"], forecast["regime"]) == (200, None, "constant")
        assert forecast["intervals"][1]["lower"] < forecast["intervals"][0]["lower"] < forecast["mean"]
        status, fan = daemon.post(f"/zones/{ZONE}/forecast", {"horizon": "2h", "inputs": {"u_heat": 800}})
        assert status == 200
        spreads = [step["outputs"][0]["sd"] for step in fan["fan"]]
        assert len(spreads) == 13
        assert (np.diff(spreads) > 0).all()
        status, parameters = daemon.get(f"/zones/{ZONE}/parameters")
        assert (status, len(parameters["parameters"]), len(parameters["time_constants"])) == (200, 10, 5)
        history = daemon.history(ZONE)
        with zenoh.open(config) as session:
            for topic in ("volatility", "gate"):
                (answer,) = session.get(f"thermogate/semi-synthetic/{ZONE}/{topic}", timeout=60)
                document = json.loads(answer.ok.payload.to_bytes())
                assert document.get("volatility", document.get("n_eff")) is None
        assert daemon.terminate() == 0
    assert "Traceback" not in daemon.log()
    assert len(history) == len(rows)
    for entry, row in zip(history, rows, strict=True):
        for name in ("y", "mean", "lower", "upper", "log_likelihood", "alpha_median", "gate"):
            assert entry[name] == (float(row[name]) if row[name] else None), (row["time"], name)
