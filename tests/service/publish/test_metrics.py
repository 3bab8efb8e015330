"""Metrics as Prometheus reads them."""

from __future__ import annotations

import math
import platform

import pytest
from prometheus_client import REGISTRY, generate_latest
from prometheus_client.parser import text_string_to_metric_families
from support.fake_zones import FakeZone, announced, doubted, make_update, running, waiting

from estimator.diagnosis.finding import FINDINGS
from service.publish.metrics import Metrics
from service.publish.sinks import Announcement
from service.records.measures import Measure, single
from service.records.update import Disturbance, Volatility


def scrape(metrics: Metrics) -> dict[tuple[str, frozenset[tuple[str, str]]], float]:
    families = text_string_to_metric_families(generate_latest(metrics.registry).decode())
    return {(s.name, frozenset(s.labels.items())): s.value for family in families for s in family.samples}


def at(name: str, **labels: str) -> tuple[str, frozenset[tuple[str, str]]]:
    return name, frozenset(labels.items())


def test_updates_are_counted_and_described() -> None:
    metrics = Metrics({"living": running("living")})
    update = make_update(0, levels=(0.95, 0.5))
    blocks = Volatility(("air", "walls"), (0.5, 0.6), (1.0, 1.5), (2.0, 3.0), (0.3, 0.9))
    metrics.publish(announced("living", make_update(9), running("living").status()))
    later = update._replace(volatility=blocks, step_seconds=0.3)
    metrics.publish(announced("living", later, running("living").status()))
    values = scrape(metrics)
    interval = update.forecast.outputs[0].intervals[0]
    assert values[at("thermogate_samples_total", zone="living")] == 2
    assert values[at("thermogate_update_seconds_count", zone="living")] == 2
    assert values[at("thermogate_update_seconds_bucket", zone="living", le="0.25")] == 1
    assert values[at("thermogate_alpha_median", zone="living", block="walls")] == 1.5
    assert values[at("thermogate_gate", zone="living")] == update.gate.value
    assert values[at("thermogate_n_eff", zone="living")] == update.effective_sample_size
    width = values[at("thermogate_interval_width_kelvin", zone="living")]
    assert width == interval.upper - interval.lower


def test_a_room_can_be_plotted() -> None:
    metrics = Metrics({"living": running("living")})
    gained = make_update(0, levels=(0.95, 0.5))._replace(disturbance=Disturbance((-40.0, 130.0, 310.0), 0.8, ()))
    status = running("living").status()
    metrics.publish(Announcement("htwg", "living", status, gained, heat_loss=(80.0, 95.0, 120.0)))
    values = scrape(metrics)
    forecast = gained.forecast.outputs[0]
    room = {"zone": "living", "output": forecast.output}
    assert values[at("thermogate_measured_celsius", **room)] == gained.y[0]
    assert values[at("thermogate_forecast_celsius", **room)] == forecast.mean
    bounds = {
        bound: values[at("thermogate_forecast_bound_celsius", bound=bound, **room)] for bound in ("lower", "upper")
    }
    assert bounds == {"lower": forecast.intervals[0].lower, "upper": forecast.intervals[0].upper}
    quantiles = ("0.025", "0.5", "0.975")
    gains = [values[at("thermogate_gain_watts", zone="living", quantile=quantile)] for quantile in quantiles]
    losses = [values[at("thermogate_heat_loss_watts_per_kelvin", zone="living", quantile=q)] for q in quantiles]
    assert (gains, losses) == ([-40.0, 130.0, 310.0], [80.0, 95.0, 120.0])
    metrics.publish(announced("living", gained._replace(y=(math.nan,)), status))
    assert math.isnan(scrape(metrics)[at("thermogate_measured_celsius", **room)])
    metrics.remove("living")
    assert not any("celsius" in name or "watts" in name for name, _ in scrape(metrics))


def test_what_is_not_known_is_not_shown() -> None:
    metrics = Metrics({"living": running("living")})
    unknown = make_update(0)._replace(disturbance=Disturbance((math.nan,) * 3, 0.0, ()))
    metrics.publish(announced("living", unknown, running("living").status()))
    assert not any("watts" in name for name, _ in scrape(metrics))


def test_status_is_read_at_scrape_time() -> None:
    zone = running("living")
    metrics = Metrics({"living": zone})
    zone.faults = {"non_numeric": 3}
    values = scrape(metrics)
    assert values[at("thermogate_faults_total", zone="living", kind="non_numeric")] == 3
    assert values[at("thermogate_last_sample_age_seconds", zone="living")] == 360.0
    zone.state = "stalled"
    values = scrape(metrics)
    states = {name: values[at("thermogate_zone_state", zone="living", state=name)] for name in ("running", "stalled")}
    assert states == {"running": 0.0, "stalled": 1.0}


def test_findings_are_counted_by_name_and_zero_where_there_are_none() -> None:
    values = scrape(Metrics({"living": doubted("living"), "attic": waiting("attic")}))
    counts = {name: values[at("thermogate_findings", zone="living", finding=name)] for name in FINDINGS}
    assert counts == dict.fromkeys(FINDINGS, 0.0) | {"parameter-at-bound": 2.0, "network-variant": 1.0}
    assert values[at("thermogate_findings", zone="attic", finding="parameter-at-bound")] == 0.0


def test_a_waiting_zone_has_a_state_but_no_age() -> None:
    values = scrape(Metrics({"attic": waiting("attic")}))
    assert values[at("thermogate_zone_state", zone="attic", state="waiting")] == 1.0
    assert at("thermogate_last_sample_age_seconds", zone="attic") not in values


def test_zones_are_not_asked_before_the_first_scrape() -> None:
    class Unready(FakeZone):
        def status(self) -> None:
            raise AssertionError("asked while being registered")

    Metrics({"living": Unready("living")})


def test_registries_are_apart() -> None:
    first, second = Metrics({}), Metrics({})
    first.publish(announced("living", make_update(0), running("living").status()))
    assert at("thermogate_samples_total", zone="living") not in scrape(second)
    assert b"thermogate" not in generate_latest(REGISTRY)


def test_a_measure_is_read_at_every_scrape_and_not_before() -> None:
    read: list[float] = []

    def depth() -> list[tuple[tuple[str, ...], float]]:
        read.append(0.0)
        return [(("living",), float(len(read)))]

    metrics = Metrics({})
    metrics.register(
        [
            Measure("thermogate_mailbox_depth", "gauge", "Samples that wait", ("zone",), depth),
            Measure("thermogate_journal_rows", "counter", "Rows written", (), lambda: single(7.0)),
        ]
    )
    assert not read
    assert scrape(metrics)[at("thermogate_mailbox_depth", zone="living")] == 1.0
    values = scrape(metrics)
    assert values[at("thermogate_mailbox_depth", zone="living")] == 2.0
    assert values[at("thermogate_journal_rows_total")] == 7.0


def test_a_name_is_given_once() -> None:
    metrics = Metrics({})
    with pytest.raises(ValueError, match="Duplicated"):
        metrics.register([Measure("thermogate_gate", "gauge", "Another", (), lambda: single(0.0))])


def test_checkpoints_failures_and_the_process_are_counted() -> None:
    metrics = Metrics({}, version="1.2.3")
    metrics.checkpointed("living", written=True)
    metrics.checkpointed("living", written=False)
    metrics.failed("living")
    values = scrape(metrics)
    assert values[at("thermogate_checkpoints_total", zone="living", result="written")] == 1
    assert values[at("thermogate_checkpoints_total", zone="living", result="failed")] == 1
    assert values[at("thermogate_checkpoint_timestamp_seconds", zone="living")] > 1.6e9
    assert values[at("thermogate_zone_failures_total", zone="living")] == 1
    assert values[at("thermogate_build_info", version="1.2.3", python=platform.python_version())] == 1
    assert values[at("process_open_fds")] > 0
