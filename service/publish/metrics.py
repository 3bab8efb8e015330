"""Metrics for Prometheus: what happens is counted here, and the figures of every zone in `metrics.toml`, and each
Measure that its owner registers, are read at the moment of a scrape."""

import platform
import threading
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from prometheus_client import CollectorRegistry, Counter, Gauge, GCCollector, Histogram, ProcessCollector
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from adapters.fields.durations import format_duration
from estimator.diagnosis.finding import FINDINGS
from estimator.types import ALPHA_LEVELS
from service.publish.payloads import clock
from service.publish.sinks import NO_REPORTS, Announcement, Occasion, Reports, Sink
from service.records.measures import Measure
from service.records.status import STATES, ZoneState
from service.records.trust import LEVELS as TRUST_LEVELS
from service.records.update import Update
from service.records.view import ZoneView

_SKILL_DAYS = 7
_DELAY_BUCKETS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.25, 0.5, 1.0)
_UPDATE_BUCKETS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)
_COUNTERS = ("faults", "overruns")
_DESCRIBED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))

_Figure = tuple[str, float, *tuple[str, ...]]
"""The name of a metric, its value, and the values of its labels after `zone`."""


class Metrics(Sink):
    """The daemon's metrics: a sink that counts updates and keeps the newest reports."""

    def __init__(self, zones: Mapping[str, ZoneView], version: str = "unknown") -> None:
        self.registry = registry = CollectorRegistry()
        self._lock = threading.Lock()
        self._removed: set[str] = set()
        self._reports: dict[str, Reports] = {}
        self._samples = Counter("thermogate_samples", "Samples processed", ["zone"], registry=registry)
        text = "Wall time of one update"
        self._seconds = Histogram(
            "thermogate_update_seconds", text, ["zone"], buckets=_UPDATE_BUCKETS, registry=registry
        )
        registry.register(_OfZones(_DESCRIBED["forecasts"], _of_forecasts, zones, self._reports))
        name, text = "thermogate_event_loop_delay_seconds", "How late the event loop served a timer"
        self.loop_delay = Histogram(name, text, buckets=_DELAY_BUCKETS, registry=registry)
        labels = ["zone", "result"]
        self._checkpoints = Counter("thermogate_checkpoints", "Checkpoints by result", labels, registry=registry)
        name, text = "thermogate_checkpoint_timestamp_seconds", "When the newest checkpoint was written"
        self._checkpointed = Gauge(name, text, ["zone"], registry=registry)
        self._failures = Counter("thermogate_zone_failures", "Failed attempts of a zone", ["zone"], registry=registry)
        build = Gauge("thermogate_build_info", "Always 1", ["version", "python"], registry=registry)
        build.labels(version, platform.python_version()).set(1.0)
        registry.register(_OfZones(_DESCRIBED["statuses"], _of_status, zones, self._reports))
        ProcessCollector(registry=registry)
        GCCollector(registry=registry)

    def register(self, measures: Iterable[Measure]) -> None:
        """Expose `measures`, each read at every scrape. Raises ValueError for a name that is taken."""
        for measure in measures:
            self.registry.register(measure)

    def add(self, zone: str) -> None:
        """Show the counters of `zone` from now on, at 0: a scraper sees a rise only from a value that it knew."""
        self._removed.discard(zone)
        self._samples.labels(zone)
        self._failures.labels(zone)
        for result in ("written", "failed"):
            self._checkpoints.labels(zone, result)

    def remove(self, zone: str) -> None:
        """Show nothing of `zone` any more."""
        with self._lock:
            self._removed.add(zone)
            self._reports.pop(zone, None)
            for metric in (self._samples, self._seconds, self._checkpoints, self._checkpointed, self._failures):
                metric.remove_by_labels({"zone": zone})

    def publish(self, announcement: Announcement) -> None:
        """Take in what is new about a zone; hours ahead that were being computed when it was removed come too late."""
        zone, update = announcement.zone, announcement.update
        with self._lock:
            if zone in self._removed:
                return
            if announcement.occasion is Occasion.UPDATE and update is not None:
                self._samples.labels(zone).inc()
                self._seconds.labels(zone).observe(update.step_seconds)
            self._reports[zone] = announcement.reports.beside(self._reports.get(zone, NO_REPORTS))

    def checkpointed(self, zone: str, written: bool) -> None:
        """A checkpoint of `zone` was written, or could not be."""
        self._checkpoints.labels(zone, "written" if written else "failed").inc()
        if written:
            self._checkpointed.labels(zone).set_to_current_time()

    def failed(self, zone: str) -> None:
        """A step of `zone`, or the restoring of its state, failed."""
        self._failures.labels(zone).inc()


def _of_forecasts(zone: ZoneState, reports: Reports) -> Iterator[_Figure]:
    if zone.update is not None:
        yield from _of_update(zone.update)
    for output in reports.ahead.outputs if reports.ahead is not None else ():
        for ahead in output.horizons:
            labels = output.output, format_duration(ahead.lead)
            yield "forecast_ahead_celsius", ahead.mean, *labels
            yield "forecast_ahead_bound_celsius", ahead.lower, *labels, "lower"
            yield "forecast_ahead_bound_celsius", ahead.upper, *labels, "upper"
    yield from _quantiles("heat_loss_watts_per_kelvin", reports.heat_loss or ())
    if reports.skill is not None:
        for one in reports.skill.over(_SKILL_DAYS):
            if one.forecasts:
                lead = format_duration(one.lead)
                yield "forecast_coverage", one.coverage, lead
                yield "forecast_crps_kelvin", one.crps, lead
                yield "forecast_skill", one.skill_against_persistence, lead, "persistence"
                yield "forecast_skill", one.skill_against_arx, lead, "arx"
        for issued in reports.skill.issued_over(_SKILL_DAYS):
            if issued.forecasts:
                yield "forecast_issued_coverage", issued.coverage, format_duration(issued.lead)
                yield "forecast_issued_crps_kelvin", issued.crps, format_duration(issued.lead)


def _of_update(update: Update) -> Iterator[_Figure]:
    for block, median in zip(update.volatility.blocks, update.volatility.median, strict=True):
        yield "alpha_median", median, block
    yield "gate", update.shown_gate.value
    if update.effective_sample_size is not None:
        yield "n_eff", update.effective_sample_size
    for interval in update.forecast.outputs[0].intervals[:1]:
        yield "interval_width_kelvin", interval.upper - interval.lower
    for measured, forecast in zip(update.y, update.forecast.outputs, strict=True):
        yield "measured_celsius", measured, forecast.output
        yield "forecast_celsius", forecast.mean, forecast.output
        for interval in forecast.intervals[:1]:
            yield "forecast_bound_celsius", interval.lower, forecast.output, "lower"
            yield "forecast_bound_celsius", interval.upper, forecast.output, "upper"
    if isfinite(update.setpoint):
        yield "setpoint_celsius", update.setpoint
    if update.disturbance is not None and isfinite(update.disturbance.gain[1]):
        yield from _quantiles("gain_watts", update.disturbance.gain)


def _quantiles(name: str, values: Sequence[float]) -> Iterator[_Figure]:
    for level, value in zip(ALPHA_LEVELS, values, strict=False):
        yield name, value, f"{level:g}"


def _of_status(zone: ZoneState, reports: Reports) -> Iterator[_Figure]:
    status = zone.status
    named = [finding.finding for finding in status.diagnosis.findings]
    for kind, count in status.faults.items():
        yield "faults", count, kind
    if status.last_sample_time is not None:
        yield "last_sample_age_seconds", clock(status) - status.last_sample_time
    yield "overruns", status.overruns
    if status.delay is not None:
        yield "forecast_delay_seconds", status.delay
    for name in FINDINGS:
        yield "findings", named.count(name), name
    for one in zone.trust.horizons:
        for level in TRUST_LEVELS:
            yield "trust", float(one.level == level), format_duration(one.lead), level
    for name in STATES:
        yield "zone_state", float(status.state == name), name


@dataclass(frozen=True, eq=False)
class _OfZones(Collector):
    """Figures of all zones, as they are at the moment of the scrape."""

    described: Mapping[str, Sequence[str]]
    read: Callable[[ZoneState, Reports], Iterable[_Figure]]
    zones: Mapping[str, ZoneView]
    reports: Mapping[str, Reports]

    def collect(self) -> Iterable[Metric]:
        families = self._families()
        for name, zone in tuple(self.zones.items()):
            for metric, value, *labels in self.read(zone.now(), self.reports.get(name, NO_REPORTS)):
                families[metric].add_metric((name, *labels), value)
        return families.values()

    def describe(self) -> Iterable[Metric]:
        """The families alone: asking the zones is for scrapes, not for registration."""
        return self._families().values()

    def _families(self) -> dict[str, GaugeMetricFamily | CounterMetricFamily]:
        return {
            name: (CounterMetricFamily if name in _COUNTERS else GaugeMetricFamily)(
                f"thermogate_{name}", text, labels=("zone", *labels)
            )
            for name, (text, *labels) in self.described.items()
        }
