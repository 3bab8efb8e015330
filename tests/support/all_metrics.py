"""Every metric that a daemon has, without a daemon."""

from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

from service.config.http import HttpConfig
from service.daemon.instruments import instrument
from service.publish import influxdb, mqtt
from service.publish.events import Streams
from service.publish.metrics import Metrics
from service.publish.zenoh import Publisher
from service.store.store import Store
from service.web.app import create_app
from service.web.measures import http_measures
from service.web.server.server import HttpServer


def exposed() -> dict[str, str]:
    """Every metric of ours, as it is called in a scrape, with its type."""
    metrics = Metrics({})
    parts: Any = SimpleNamespace(tallies={}, feeds=(), zones={})
    with TemporaryDirectory() as folder:
        store = Store(Path(folder))
        session: Any = SimpleNamespace(info=SimpleNamespace(transports=list))
        sinks = [Publisher(session, "site"), mqtt.Publisher(mqtt.MqttConfig(), "site"), Streams()]
        instrument(metrics, parts, store, [*sinks, influxdb.Writer(influxdb.to_file(Path(folder) / "lines"))])
        store.close()
    app = create_app("site", {}, metrics.registry)
    server = HttpServer(app, HttpConfig(port=0))
    server.close()
    metrics.register(http_measures(server, app))
    return {
        f"{family.name}_total" if family.type == "counter" else family.name: family.type
        for family in metrics.registry.collect()
        if family.name.startswith("thermogate_")
    }
