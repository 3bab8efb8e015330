"""The REST interface of the daemon, and the live page on top of it."""

from __future__ import annotations

import gzip
import time
from collections import Counter
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.openapi.utils import get_openapi
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import choose_encoder, gzip_accepted
from starlette.middleware.gzip import GZipMiddleware

from service import api_pages, api_problems
from service.api_access import Keys, NoKeys, RequireKey
from service.api_guard import GatherBody, Guard
from service.api_limits import StreamLimits
from service.api_models import HealthPayload, ReadyPayload
from service.api_problems import RETRY_SECONDS, Problem, RequestRefused, documented
from service.api_stream import stream_routes
from service.api_zones import zone_routes
from service.http_models import HttpConfig
from service.payloads import to_json
from service.streams import Streams
from service.view import ZoneView

_DESCRIPTION = """Calibrated temperature forecasts, volatility and learning gate of every zone.

Times are RFC 3339 in UTC and must carry a zone in requests. Temperatures are in degC, their differences and standard
deviations in K. A number that is not finite is null. Errors are application/problem+json (RFC 9457)."""


def create_app(
    site: str,
    zones: Mapping[str, ZoneView],
    metrics_registry: CollectorRegistry,
    *,
    version: str = "unknown",
    keys: Keys | None = None,
    http: HttpConfig | None = None,
    streams: Streams | None = None,
) -> FastAPI:
    """The ASGI application that serves `zones` (by id, in the order to list them) and the metrics in a registry.

    `keys` open it; without, reading is open and administration closed. `http` has the hosts it answers for and the
    limits. `streams` is where the zones announce what happens; without it a stream tells what there is and no more.

    It needs nothing from outside: no request leaves the machine, neither from here nor from the pages it serves.
    """
    # FastAPI's own documentation pages load their scripts from a CDN; a plant room has none.
    app = FastAPI(title="Thermogate", version=version, description=_DESCRIPTION, docs_url=None, redoc_url=None)
    api_problems.install(app)
    http = http or HttpConfig()
    app.state.streams = StreamLimits(http.limits.streams_per_client, http.limits.streams)
    # The last one added is the first to see a request.
    app.add_middleware(GZipMiddleware, minimum_size=1024, compresslevel=5)
    app.add_middleware(GatherBody, limit=http.limits.body)
    app.add_middleware(RequireKey, keys=keys or NoKeys())
    app.state.answers = Counter()
    app.add_middleware(Guard, config=http, answers=app.state.answers)
    app.include_router(zone_routes(site, zones))
    app.include_router(stream_routes(site, zones, streams or Streams(site)))
    _add_operations(app, zones, metrics_registry, version)
    api_pages.install(app)
    app.openapi = lambda: _document(app)  # type: ignore[method-assign]
    return app


def _add_operations(
    app: FastAPI, zones: Mapping[str, ZoneView], metrics_registry: CollectorRegistry, version: str
) -> None:
    started = time.monotonic()

    @app.get("/healthz", tags=["operations"], response_model=HealthPayload, summary="The process is alive")
    async def healthz() -> Response:
        payload = HealthPayload(version=version, uptime_s=time.monotonic() - started)
        return Response(to_json(payload), media_type="application/json")

    @app.get(
        "/readyz",
        tags=["operations"],
        response_model=ReadyPayload,
        responses=documented(500, 503),
        summary="Every zone is fed and fresh",
    )
    def readyz() -> Response:
        statuses = {zone.id: zone.status() for zone in zones.values()}
        behind = [
            {"id": zone, "state": status.state, "reason": status.reason}
            for zone, status in statuses.items()
            if status.state != "running"
        ]
        if behind:
            sentences = [f"zone '{zone['id']}' is {zone['state']}: {zone['reason']}" for zone in behind]
            raise RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, sentences, retry_after=RETRY_SECONDS, zones=behind)
        payload = ReadyPayload(zones={zone: status.state for zone, status in statuses.items()})
        return Response(to_json(payload), media_type="application/json")

    @app.get(
        "/metrics",
        tags=["operations"],
        response_class=Response,
        responses={200: {"description": "Prometheus exposition", "content": {"text/plain": {}}}},
        summary="Metrics for Prometheus",
    )
    def metrics(request: Request) -> Response:
        # Written and compressed in a thread: with many zones it is megabytes, for which the event loop must not wait.
        encode, media_type = choose_encoder(request.headers.get("accept", ""))
        body, headers = encode(metrics_registry), {"Content-Type": media_type}
        if gzip_accepted(request.headers.get("accept-encoding", "")):
            body = gzip.compress(body, compresslevel=1)
            headers |= {"Content-Encoding": "gzip", "Vary": "Accept-Encoding"}
        return Response(body, headers=headers)


def _document(app: FastAPI) -> dict[str, Any]:
    """The OpenAPI document, with the schema of the problems that FastAPI cannot see."""
    if app.openapi_schema is None:
        document = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
        document["components"]["schemas"]["Problem"] = Problem.model_json_schema()
        app.openapi_schema = document
    return app.openapi_schema
