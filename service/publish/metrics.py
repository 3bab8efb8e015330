"""Metrics for Prometheus, in a registry of their own.

What happens is counted here by the one who sees it (`publish`, ...). What there is at the moment of a scrape is a
`service.records.measures.Measure` that its owner offers, and is registered with `Metrics.register`.
"""

from __future__ import annotations

import platform
import threading
from collections.abc import Iterable, Mapping
from math import isfinite

from prometheus_client import CollectorRegistry, Counter, Gauge, GCCollector, Histogram, ProcessCollector
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from adapters.fields.durations import format_duration
from estimator.diagnosis.finding import FINDINGS
from estimator.types import ALPHA_LEVELS
from service.publish.payloads import AheadPayload, clock
from service.publish.sinks import Announcement, Occasion, Sink
from service.records.measures import Measure, family
from service.records.skill import Skill
from service.records.status import STATES
from service.records.trust import LEVELS as TRUST_LEVELS
from service.records.update import Update
from service.records.view import ZoneView

_SKILL_DAYS = 7
_DELAY_BUCKETS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.25, 0.5, 1.0)
_UPDATE_BUCKETS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)


class Metrics(Sink):
    """The daemon's metrics: a sink that counts updates. What a zone's status tells is read at scrape time."""

    def __init__(self, zones: Mapping[str, ZoneView], version: str = "unknown") -> None:
        self.registry = registry = CollectorRegistry()
        self._lock = threading.Lock()
        self._removed: set[str] = set()
        self._of_zones: list[Counter | Gauge | Histogram] = []

        def gauge(name: str, text: str, *labels: str) -> Gauge:
            made = Gauge(f"thermogate_{name}", text, ["zone", *labels], registry=registry)
            self._of_zones.append(made)
            return made

        def counter(name: str, text: str, *labels: str) -> Counter:
            made = Counter(f"thermogate_{name}", text, ["zone", *labels], registry=registry)
            self._of_zones.append(made)
            return made

        self._samples = counter("samples", "Samples processed")
        self._seconds = Histogram(
            "thermogate_update_seconds", "Wall time of one update", ["zone"], buckets=_UPDATE_BUCKETS, registry=registry
        )
        self._of_zones.append(self._seconds)
        self._alpha = gauge("alpha_median", "Median of the volatility", "block")
        self._gate = gauge("gate", "Learning gate, 0 to 1")
        self._n_eff = gauge("n_eff", "Effective sample size, particles")
        self._width = gauge(
            "interval_width_kelvin", "Width of the published interval of the first output, at the first level"
        )
        self._measured = gauge("measured_celsius", "Mean of the newest sample; NaN if it has none", "output")
        self._setpoint = gauge("setpoint_celsius", "Set-point of the newest sample")
        self._forecast = gauge("forecast_celsius", "Forecast of the next sample: its mean", "output")
        self._bounds = gauge(
            "forecast_bound_celsius",
            "Forecast of the next sample: lower and upper bound at the first level",
            "output",
            "bound",
        )
        self._ahead = gauge("forecast_ahead_celsius", "Forecast hours ahead: its mean", "output", "lead")
        self._ahead_bounds = gauge(
            "forecast_ahead_bound_celsius",
            "Forecast hours ahead: lower and upper bound of the 95 % interval",
            "output",
            "lead",
            "bound",
        )
        self._gain = gauge("gain_watts", "Unmeasured heat into the zone", "quantile")
        self._heat_loss = gauge("heat_loss_watts_per_kelvin", "Heat-loss coefficient, every hour", "quantile")
        self._coverage = gauge("forecast_coverage", "Share of forecasts whose 95 % interval held, 7 days", "lead")
        self._crps = gauge("forecast_crps_kelvin", "Mean CRPS of forecasts, 7 days", "lead")
        self._skill = gauge("forecast_skill", "1 - RMSE / RMSE of the reference, 7 days", "lead", "reference")
        self._issued_coverage = gauge(
            "forecast_issued_coverage",
            "Share of 95 % intervals that held what came, as published when nobody knew the heating, 7 days",
            "lead",
        )
        self._issued_crps = gauge(
            "forecast_issued_crps_kelvin",
            "Mean CRPS of forecasts as published when nobody knew the heating, 7 days",
            "lead",
        )
        self._loop_delay = Histogram(
            "thermogate_event_loop_delay_seconds",
            "How late the event loop served a timer",
            buckets=_DELAY_BUCKETS,
            registry=registry,
        )
        self._checkpoints = counter("checkpoints", "Checkpoints by result", "result")
        self._checkpointed = gauge("checkpoint_timestamp_seconds", "When the newest checkpoint was written")
        self._failures = counter("zone_failures", "Failed attempts of a zone")
        build = Gauge("thermogate_build_info", "Always 1", ["version", "python"], registry=registry)
        build.labels(version, platform.python_version()).set(1.0)
        registry.register(_StatusCollector(zones))
        ProcessCollector(registry=registry)
        GCCollector(registry=registry)

    def register(self, measures: Iterable[Measure]) -> None:
        """Expose `measures`, each read at every scrape. Raises ValueError for a name that is taken."""
        for measure in measures:
            self.registry.register(_MeasureCollector(measure))

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
            for metric in self._of_zones:
                metric.remove_by_labels({"zone": zone})

    def publish(self, announcement: Announcement) -> None:
        """Take in what is new about a zone; hours ahead that were being computed when it was removed come too late."""
        with self._lock:
            if announcement.zone not in self._removed:
                self._take(announcement)

    def _take(self, announcement: Announcement) -> None:
        if announcement.occasion is Occasion.UPDATE and announcement.update is not None:
            self._observe(announcement.zone, announcement.update)
        reports = announcement.reports
        if reports.skill is not None:
            self._observe_skill(announcement.zone, reports.skill)
        if reports.ahead is not None:
            self._observe_ahead(announcement.zone, reports.ahead)
        if reports.heat_loss is not None:
            for level, value in zip(ALPHA_LEVELS, reports.heat_loss, strict=True):
                self._heat_loss.labels(announcement.zone, f"{level:g}").set(value)

    def observe_loop_delay(self, seconds: float) -> None:
        """Take in how late the event loop was for one timer."""
        self._loop_delay.observe(seconds)

    def checkpointed(self, zone: str, written: bool) -> None:
        """A checkpoint of `zone` was written, or could not be."""
        self._checkpoints.labels(zone, "written" if written else "failed").inc()
        if written:
            self._checkpointed.labels(zone).set_to_current_time()

    def failed(self, zone: str) -> None:
        """A step of `zone`, or the restoring of its state, failed."""
        self._failures.labels(zone).inc()

    def _observe(self, zone: str, update: Update) -> None:
        self._samples.labels(zone).inc()
        self._seconds.labels(zone).observe(update.step_seconds)
        for block, median in zip(update.volatility.blocks, update.volatility.median, strict=True):
            self._alpha.labels(zone, block).set(median)
        self._gate.labels(zone).set(update.shown_gate.value)
        if update.effective_sample_size is not None:
            self._n_eff.labels(zone).set(update.effective_sample_size)
        for interval in update.forecast.outputs[0].intervals[:1]:
            self._width.labels(zone).set(interval.upper - interval.lower)
        for measured, forecast in zip(update.y, update.forecast.outputs, strict=True):
            self._measured.labels(zone, forecast.output).set(measured)
            self._forecast.labels(zone, forecast.output).set(forecast.mean)
            for interval in forecast.intervals[:1]:
                self._bounds.labels(zone, forecast.output, "lower").set(interval.lower)
                self._bounds.labels(zone, forecast.output, "upper").set(interval.upper)
        if isfinite(update.setpoint):
            self._setpoint.labels(zone).set(update.setpoint)
        if update.disturbance is not None and isfinite(update.disturbance.gain[1]):
            for level, gain in zip(ALPHA_LEVELS, update.disturbance.gain, strict=True):
                self._gain.labels(zone, f"{level:g}").set(gain)

    def _observe_skill(self, zone: str, skill: Skill) -> None:
        for one in skill.over(_SKILL_DAYS):
            if one.forecasts:
                lead = format_duration(one.lead)
                self._coverage.labels(zone, lead).set(one.coverage)
                self._crps.labels(zone, lead).set(one.crps)
                self._skill.labels(zone, lead, "persistence").set(one.skill_against_persistence)
                self._skill.labels(zone, lead, "arx").set(one.skill_against_arx)
        for issued in skill.issued_over(_SKILL_DAYS):
            if issued.forecasts:
                lead = format_duration(issued.lead)
                self._issued_coverage.labels(zone, lead).set(issued.coverage)
                self._issued_crps.labels(zone, lead).set(issued.crps)

    def _observe_ahead(self, zone: str, ahead: AheadPayload) -> None:
        for output in ahead.outputs:
            for one in output.horizons:
                labels = zone, output.output, format_duration(one.lead)
                self._ahead.labels(*labels).set(one.mean)
                self._ahead_bounds.labels(*labels, "lower").set(one.lower)
                self._ahead_bounds.labels(*labels, "upper").set(one.upper)


class _MeasureCollector(Collector):
    """One measure; without describing it beforehand, for that would read it."""

    def __init__(self, measure: Measure) -> None:
        self._measure = measure

    def collect(self) -> Iterable[Metric]:
        return (family(self._measure),)

    def describe(self) -> Iterable[Metric]:
        """The family alone: nothing is read for a registration."""
        return (family(self._measure._replace(read=tuple)),)


class _StatusCollector(Collector):
    """What the zones' statuses say at the moment of the scrape."""

    def __init__(self, zones: Mapping[str, ZoneView]) -> None:
        self._zones = zones

    def collect(self) -> Iterable[Metric]:
        faults = CounterMetricFamily("thermogate_faults", "Bad readings by kind", labels=["zone", "kind"])
        age = GaugeMetricFamily(
            "thermogate_last_sample_age_seconds", "Age of the last sample on the zone's clock", labels=["zone"]
        )
        state = GaugeMetricFamily(
            "thermogate_zone_state", "1 for the state that the zone is in", labels=["zone", "state"]
        )
        overruns = CounterMetricFamily(
            "thermogate_overruns", "Forecasts that were published after the next sample was due", labels=["zone"]
        )
        delay = GaugeMetricFamily(
            "thermogate_forecast_delay_seconds",
            "How long after its sample the newest forecast was published",
            labels=["zone"],
        )
        trust = GaugeMetricFamily(
            "thermogate_trust", "1 for the trust in the forecasts of a horizon", labels=["zone", "lead", "trust"]
        )
        findings = GaugeMetricFamily(
            "thermogate_findings", "Findings about the zone's model by name", labels=["zone", "finding"]
        )
        for zone in tuple(self._zones.values()):
            status = zone.status()
            named = [finding.finding for finding in status.diagnosis.findings]
            for name in FINDINGS:
                findings.add_metric([zone.id, name], named.count(name))
            for kind, count in status.faults.items():
                faults.add_metric([zone.id, kind], count)
            if status.last_sample_time is not None:
                age.add_metric([zone.id], clock(status) - status.last_sample_time)
            overruns.add_metric([zone.id], status.overruns)
            if status.delay is not None:
                delay.add_metric([zone.id], status.delay)
            for one in zone.trust().horizons:
                for level in TRUST_LEVELS:
                    labels = [zone.id, format_duration(one.lead), level]
                    trust.add_metric(labels, float(one.level == level))
            for name in STATES:
                state.add_metric([zone.id, name], float(status.state == name))
        return (faults, age, state, overruns, delay, findings, trust)

    def describe(self) -> Iterable[Metric]:
        """Nothing: asking the zones is for scrapes, not for registration."""
        return ()
