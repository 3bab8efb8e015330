"""What the HTTP server is asked and whom it turns away, as figures read at a scrape."""

from __future__ import annotations

from collections import Counter

from fastapi import FastAPI

from service.records.measures import Measure, Rows, single
from service.web.limits import STREAMS
from service.web.server.server import HttpServer


def http_measures(server: HttpServer, app: FastAPI) -> list[Measure]:
    """Connections, streams, answers and the certificate of `server`, which serves `app` of `create_app`."""

    def streams() -> Rows:
        return single(app.state.limiter.open(STREAMS))

    def expiry() -> Rows:
        return () if server.certificate is None else single(server.certificate.expires.timestamp())

    def counted(counts: Counter[str]) -> Rows:
        return [((label,), float(count)) for label, count in tuple(counts.items())]

    return [
        Measure("thermogate_http_connections", "gauge", "Open connections", (), lambda: single(server.connections)),
        Measure("thermogate_http_streams", "gauge", "Open event streams", (), streams),
        Measure(
            "thermogate_http_answers", "counter", "Answers by status", ("status",), lambda: counted(app.state.answers)
        ),
        Measure(
            "thermogate_http_malformed_posts",
            "counter",
            "Posted readings that could not be read, by kind",
            ("kind",),
            lambda: counted(app.state.malformed_posts),
        ),
        Measure(
            "thermogate_http_cut_off",
            "counter",
            "Connections ended because of their client, by reason",
            ("reason",),
            lambda: counted(server.cut_off),
        ),
        Measure(
            "thermogate_certificate_expiry_timestamp_seconds",
            "gauge",
            "When the certificate of REST ends, UTC seconds",
            (),
            expiry,
        ),
    ]
