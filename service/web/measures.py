"""What the HTTP server is asked and whom it turns away, as figures read at a scrape."""

from collections import Counter
from collections.abc import Callable

from fastapi import FastAPI

from service.records.measures import Measure, Rows, single
from service.web.limits import STREAMS
from service.web.server.server import HttpServer


def http_measures(server: HttpServer, app: FastAPI) -> list[Measure]:
    """Connections, streams, answers and the certificate of `server`, which serves `app` of `create_app`."""

    def expiry() -> Rows:
        return () if server.certificate is None else single(server.certificate.expires.timestamp())

    def counted(counts: Counter[str]) -> Rows:
        return [((label,), float(count)) for label, count in tuple(counts.items())]

    read: dict[str, Callable[[], Rows]] = {
        "http_connections": lambda: single(server.connections),
        "http_streams": lambda: single(app.state.limiter.open(STREAMS)),
        "http_answers": lambda: counted(app.state.answers),
        "http_malformed_posts": lambda: counted(app.state.malformed_posts),
        "http_cut_off": lambda: counted(server.cut_off),
        "certificate_expiry_timestamp_seconds": expiry,
    }
    return [Measure.called(f"thermogate_{name}", one) for name, one in read.items()]
