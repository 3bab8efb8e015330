"""Every figure of the daemon that is read at the moment of a scrape."""

from collections.abc import Callable, Sequence

from service.daemon.runtime import Runtime
from service.publish.metrics import Metrics
from service.publish.sinks import Sink
from service.records.measures import Measure, Rows
from service.store.journalling import JournalStore


def instrument(metrics: Metrics, runtime: Runtime, store: JournalStore, sinks: Sequence[Sink]) -> None:
    """Register the figures of a daemon's parts with `metrics`."""
    metrics.register(_measures(runtime))
    for sink in sinks:
        metrics.register(sink.measures())
    metrics.register(store.measures())


def _measures(runtime: Runtime) -> list[Measure]:
    """What the sources have delivered, by `source`, and what waits in the zones, by `zone`."""

    def tallied(field: str) -> Callable[[], Rows]:
        return lambda: [((name,), float(getattr(tally, field))) for name, tally in tuple(runtime.tallies.items())]

    def counted(field: str) -> Callable[[], Rows]:
        # By the source itself, if it can happen to a source of its kind.
        return lambda: [
            ((feed.name,), float(getattr(feed.source, field))) for feed in runtime.feeds if hasattr(feed.source, field)
        ]

    def malformed() -> Rows:
        return [
            ((feed.name, kind), float(count))
            for feed in runtime.feeds
            for kind, count in tuple(getattr(feed.source, "malformed", {}).items())
        ]

    def last() -> Rows:
        return [((name,), tally.last) for name, tally in tuple(runtime.tallies.items()) if tally.last is not None]

    def waiting() -> Rows:
        return [((name,), float(zone.busy.waiting)) for name, zone in runtime.zones.items()]

    source, moment = ("source",), "thermogate_source_last_delivery_timestamp_seconds"
    return [
        Measure("thermogate_source_up", "gauge", "1 while it delivers", source, tallied("delivers")),
        Measure("thermogate_source_readings", "counter", "Readings delivered", source, tallied("readings")),
        Measure("thermogate_source_failures", "counter", "Times it failed", source, tallied("failures")),
        Measure("thermogate_source_dropped", "counter", "Samples that found no room", source, counted("dropped")),
        Measure("thermogate_source_late_polls", "counter", "Polls that came too late", source, counted("late")),
        Measure("thermogate_source_malformed", "counter", "What it could not use", (*source, "kind"), malformed),
        Measure(moment, "gauge", "When it last delivered", source, last),
        Measure("thermogate_mailbox_depth", "gauge", "Samples waiting or under way", ("zone",), waiting),
    ]
