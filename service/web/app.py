"""The REST interface of the daemon, and the live page on top of it."""

import json
from collections import Counter
from collections.abc import Callable, Mapping
from functools import cache
from threading import Lock
from typing import Any

from fastapi import Depends, FastAPI, Request, Response
from fastapi.openapi.utils import get_openapi
from prometheus_client import CollectorRegistry
from starlette.middleware.gzip import GZipMiddleware

from service.config.http import HttpConfig
from service.publish.events import Streams
from service.records.view import ZoneView
from service.web import problems as api_problems
from service.web import stream
from service.web import zones as zone_routes
from service.web.access import ADMIN_PREFIX, OPEN_PATHS, READINGS, RequireKey
from service.web.answering import json_answer
from service.web.control import heating
from service.web.control import routes as control_routes
from service.web.guard import Guard
from service.web.keys import KeyRing
from service.web.limits import Limiter
from service.web.models import PostedReadings
from service.web.operations import operation_routes
from service.web.page import files, room, series
from service.web.page.overview import overview_routes
from service.web.problems import Problem, problem_response
from service.web.readings import reading_routes
from service.web.server.bodies import GatherBody
from service.web.site import Backend, Site

_DESCRIPTION = """Calibrated temperature forecasts, volatility and learning gate of every zone.

Times are RFC 3339 in UTC and must carry a zone in requests. Temperatures are in degC, their differences and standard
deviations in K. A number that is not finite is null. Errors are application/problem+json (RFC 9457)."""
SMALLEST_PACKED = 1024
"""Bytes from which an answer is compressed for a client that takes that."""
_QUESTIONS = (zone_routes.router, control_routes.router, heating.router)
"""The routes that read zones."""


def create_app(
    site: str,
    zones: Mapping[str, ZoneView],
    metrics_registry: CollectorRegistry,
    *,
    keys: KeyRing | None = None,
    http: HttpConfig | None = None,
    backend: Backend | None = None,
) -> FastAPI:
    """The ASGI application that serves `zones` (by id, in the order to list them) and the metrics in a registry.

    `keys` open it; without, reading is open and administration closed. `http` has the hosts it answers for and the
    limits.

    It needs nothing from outside: no request leaves the machine, neither from here nor from the pages it serves.
    """
    # FastAPI's own documentation pages load their scripts from a CDN; a plant room has none. Its route of the document
    # would write it anew for every client.
    app = FastAPI(
        title="Thermogate",
        # Of the interface: which version of the program this is, is for those with a key.
        version="1",
        description=_DESCRIPTION,
        openapi_url=None,
        dependencies=[Depends(api_problems.known_parameters)],
    )
    api_problems.install(app)
    http, backend = http or HttpConfig(), backend or Backend()
    limiter = app.state.limiter = Limiter(http.limits)
    # The last one added is the first to see a request.
    app.add_middleware(GZipMiddleware, minimum_size=SMALLEST_PACKED, compresslevel=5)
    app.add_middleware(GatherBody, limit=http.limits.body)
    app.add_middleware(RequireKey, keys=keys)
    app.state.answers = Counter()
    app.add_middleware(Guard, config=http, answers=app.state.answers)
    malformed = app.state.malformed_posts = Counter()
    made = app.state.site = Site(site, zones, limiter, backend.streams or Streams(), backend)
    readings = reading_routes(made, http.limits.body, malformed)
    of_the_page = (stream.router, series.router, room.router, overview_routes(made))
    for router in (*_QUESTIONS, readings, *of_the_page, operation_routes(metrics_registry)):
        app.include_router(router)
    files.install(app)
    app.add_route("/openapi.json", _described(app), include_in_schema=False)
    return app


def create_questions(site: str, zones: Mapping[str, ZoneView], time_zone: str | None = None) -> FastAPI:
    """The routes that read zones, without what guards them: for questions that come another way."""
    app = FastAPI(
        docs_url=None, redoc_url=None, openapi_url=None, dependencies=[Depends(api_problems.known_parameters)]
    )
    api_problems.install(app)
    app.state.site = Site(site, zones, Limiter(), Streams(), Backend(time_zone=time_zone))
    for router in _QUESTIONS:
        app.include_router(router)
    return app


def _described(app: FastAPI) -> Callable[[Request], Response]:
    """The endpoint of the OpenAPI document, which is written once, when the first client asks, on its thread."""
    writing, written = Lock(), cache(lambda: json.dumps(_written(app)).encode())

    def endpoint(request: Request) -> Response:
        with writing:
            return json_answer(written())

    return endpoint


def _written(app: FastAPI) -> dict[str, Any]:
    """The OpenAPI document, with the schemas that FastAPI cannot see."""
    document = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
    schemas = document["components"]["schemas"]
    for model in (Problem, PostedReadings):
        schema = model.model_json_schema(ref_template="#/components/schemas/{model}")
        schemas |= schema.pop("$defs", {}) | {model.__name__: schema}
    document["components"]["securitySchemes"] = {"key": {"type": "http", "scheme": "bearer"}}
    for path, operations in document["paths"].items():
        for operation in operations.values():
            # Any request may be refused for its key, its size or its pace, before it is looked at.
            operation["responses"] |= {"default": problem_response("refused: key, size or pace")}
            operation["security"] = _security(path)
    return document


def _security(path: str) -> list[dict[str, list[str]]]:
    """The alternatives that a caller of `path` has: the key, or nothing."""
    if path in OPEN_PATHS:
        return [{}]
    always = path.startswith(ADMIN_PREFIX) or path.endswith(f"/{READINGS}")
    return [{"key": []}] if always else [{"key": []}, {}]
