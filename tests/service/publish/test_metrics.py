"""Metrics as Prometheus reads them."""

import math
import platform

from prometheus_client import generate_latest
from prometheus_client.parser import text_string_to_metric_families
from support.fake_zones import FakeZone, announced, make_update, running

from service.publish.metrics import Metrics
from service.records.measures import Measure
from service.records.update import Disturbance


def scrape(metrics: Metrics) -> dict[tuple[str, frozenset[tuple[str, str]]], float]:
    families = text_string_to_metric_families(generate_latest(metrics.registry).decode())
    return {(s.name, frozenset(s.labels.items())): s.value for family in families for s in family.samples}


def at(name: str, **labels: str) -> tuple[str, frozenset[tuple[str, str]]]:
    return name, frozenset(labels.items())


def test_figures_are_read_at_scrape_time_and_what_is_not_known_is_not_shown() -> None:
    zone = running("living")
    zone.updates.append(make_update(0)._replace(disturbance=Disturbance((math.nan,) * 3, 0.0, ())))
    metrics = Metrics({"living": zone})
    zone.faults, zone.state = {"non_numeric": 3}, "stalled"
    values = scrape(metrics)
    assert values[at("thermogate_faults_total", zone="living", kind="non_numeric")] == 3
    states = {name: values[at("thermogate_zone_state", zone="living", state=name)] for name in ("running", "stalled")}
    assert states == {"running": 0.0, "stalled": 1.0}
    assert not any("watts" in name for name, _ in values)


def test_zones_are_not_asked_before_the_first_scrape() -> None:
    class Unready(FakeZone):
        def now(self) -> None:
            raise AssertionError("asked while being registered")

    Metrics({"living": Unready("living")})


def test_a_measure_is_read_at_every_scrape_and_not_before() -> None:
    read: list[float] = []

    def depth() -> list[tuple[tuple[str, ...], float]]:
        read.append(0.0)
        return [(("living",), float(len(read)))]

    metrics = Metrics({})
    metrics.register([Measure("thermogate_mailbox_depth", "gauge", "Samples that wait", ("zone",), depth)])
    assert not read
    for count in (1.0, 2.0):
        assert scrape(metrics)[at("thermogate_mailbox_depth", zone="living")] == count


def test_checkpoints_failures_and_the_process_are_counted() -> None:
    metrics = Metrics({}, version="1.2.3")
    for written in (True, False):
        metrics.checkpointed("living", written)
    metrics.failed("living")
    values = scrape(metrics)
    for result in ("written", "failed"):
        assert values[at("thermogate_checkpoints_total", zone="living", result=result)] == 1
    assert values[at("thermogate_checkpoint_timestamp_seconds", zone="living")] > 1.6e9
    assert values[at("thermogate_zone_failures_total", zone="living")] == 1
    assert values[at("thermogate_build_info", version="1.2.3", python=platform.python_version())] == 1
    assert values[at("process_open_fds")] > 0


def test_what_was_computed_of_a_zone_that_is_removed_meanwhile_shows_nothing_of_it() -> None:
    metrics, news = Metrics({}), announced("living", make_update(0), running("living").now().status)
    for _ in range(2):
        metrics.add("living")
        metrics.publish(news)
        assert any(dict(labels).get("zone") == "living" for _, labels in scrape(metrics))
        metrics.remove("living")
        metrics.publish(news)
        assert not any(dict(labels).get("zone") == "living" for _, labels in scrape(metrics))
