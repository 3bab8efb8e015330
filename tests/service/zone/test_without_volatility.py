"""Zones whose estimator has no volatility (EKF, UKF): a step, its payloads, its history row, its metrics, its state."""

import json
import math

import numpy as np
import pytest
from prometheus_client import generate_latest
from support.fake_zones import FakeZone, announced
from support.forecasts import fan_of
from support.zone_samples import PERIOD, comparable, sample

from estimator.network.presets import network
from estimator.registry import build, resolve, structure
from service.publish.metrics import Metrics
from service.publish.payloads import ForecastPayload, GatePayload, VolatilityPayload
from service.records.record import to_json, values
from service.store.checkpoint import CheckpointStore
from service.zone import snapshot
from service.zone.worker import WorkerSettings, ZoneWorker

NAN = float("nan")


def worker(name):
    estimator = build(name, network("ecolar-6r4c"), PERIOD, {})
    return ZoneWorker(estimator, WorkerSettings(5, (0.95, 0.5), 3, 900.0))


@pytest.fixture(params=["ekf", "ukf"])
def stepped(request):
    zone = worker(request.param)
    return zone, [zone.step(sample(k)) for k in range(12)]


def test_what_it_does_not_have_is_null_and_the_rest_is_there(stepped):
    _, updates = stepped
    forecast = json.loads(to_json(ForecastPayload.of(updates[-1])))
    assert forecast["volatility"] is None
    assert forecast["n_eff"] is None
    assert (forecast["gate"], forecast["regime"], forecast["quality"]) == (1.0, "constant", "good")
    half = forecast["sd"] * 1.959964
    assert forecast["intervals"][0]["upper"] == pytest.approx(forecast["mean"] + half)
    assert forecast["median"] == forecast["mean"]
    gate = json.loads(to_json(GatePayload.of(updates[-1])))
    assert (gate["gate"], gate["regime"], gate["n_eff"], gate["resampled"]) == (1.0, "constant", None, False)
    assert gate["log_likelihood"] == updates[-1].log_likelihood
    assert json.loads(to_json(VolatilityPayload.of(updates[-1])))["volatility"] is None


def test_the_gate_is_shut_where_nothing_was_learned(stepped):
    zone, updates = stepped
    assert (updates[0].outcome, updates[0].shown_gate) == ("started", (0.0, "constant"))
    assert (updates[1].outcome, updates[1].shown_gate) == ("assimilated", (1.0, "constant"))
    missing = zone.step(sample(12, y=NAN))
    assert (missing.outcome, missing.shown_gate) == ("missing", (0.0, "constant"))
    vanished = zone.step(sample(13, y=70.0))
    assert (vanished.outcome, vanished.shown_gate) == ("vanished", (0.0, "constant"))
    assert {(update.gate, update.effective_sample_size) for update in (*updates, missing, vanished)} == {(None, None)}


def test_metrics_leave_out_what_is_not_there(stepped):
    _, updates = stepped
    metrics = Metrics({"z": FakeZone("z")})
    metrics.publish(announced("z", updates[-1], FakeZone("z").status()))
    text = generate_latest(metrics.registry).decode()
    assert 'thermogate_gate{zone="z"} 1.0' in text
    assert "thermogate_alpha_median{" not in text
    assert "thermogate_n_eff{" not in text


def test_a_checkpoint_continues_bit_for_bit(stepped, tmp_path):
    zone, _ = stepped
    store = CheckpointStore(tmp_path)
    store.save("z", snapshot.take(zone, "mark", "ekf"))
    again, stored = ZoneWorker(zone.estimator, zone.settings), store.load("z", "mark")
    snapshot.restore(again, stored)
    assert comparable(again.latest) == comparable(zone.latest)
    gate, sample_size = stored.meta["latest"][6:8]
    assert gate == [1.0, "constant"], "as every version before has written it"
    assert math.isnan(sample_size)
    for k in range(12, 20):
        assert comparable(zone.step(sample(k))) == comparable(again.step(sample(k)))
    left, right = (fan_of(w, 3, {"u_heat": 1000.0}).outputs[0] for w in (zone, again))
    for one, other in zip(values(left), values(right), strict=True):
        np.testing.assert_array_equal(one, other)


def test_tuning_may_change_between_two_starts_but_not_the_estimator():
    net = network("ecolar-6r4c")
    marks = {
        (name, sd): snapshot.fingerprint(net, 300, name, structure(name, resolve(name, net, 300, {"parameter_sd": sd})))
        for name in ("ekf", "ukf")
        for sd in (0.001, 0.1)
    }
    assert marks["ekf", 0.001] == marks["ekf", 0.1]
    assert marks["ekf", 0.1] != marks["ukf", 0.1]
