"""The routes that run the daemon rather than use it: is it alive, are the zones fed, metrics, reload."""

import json
import time
from http import HTTPStatus
from typing import Any

from fastapi import APIRouter, Request, Response
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import choose_encoder

from service.errors import ReloadRefused
from service.publish.payloads import StatusPayload
from service.records.record import to_json
from service.records.status import STATES, ZoneStatus
from service.records.view import ZoneView
from service.store.audit import AUDIT, about
from service.web.access import MOST_NAMES, NOBODY, Asking
from service.web.answering import json_answer, route
from service.web.models import HealthPayload, ReadyPayload, ReloadPayload, ZoneReadiness
from service.web.problems import RETRY_SECONDS
from service.web.server.refusal import RequestRefused, few
from service.web.site import Here


def operation_routes(metrics_registry: CollectorRegistry) -> APIRouter:
    """Routes about the daemon as a whole."""
    router, started = APIRouter(tags=["operations"]), time.monotonic()

    @route(router, "GET /healthz", refused=(500, 503), response_model=HealthPayload)
    async def healthz(site: Here, caller: Asking) -> Response:
        """The process is alive: event loop, estimator and journal answer"""
        if found := site.backend.problems():
            raise RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, found, retry_after=RETRY_SECONDS)
        known = None if caller is NOBODY else site.backend.version
        return json_answer(to_json(HealthPayload(known, time.monotonic() - started)))

    @route(router, "GET /readyz", refused=(500, 503), response_model=ReadyPayload)
    def readyz(site: Here) -> Response:
        """Every zone is fed and fresh, and how old what each knows is"""
        every = [(zone, zone.now().status) for zone in site.zones.values()]
        behind = [(zone, status) for zone, status in every if status.state != "running"]
        if behind:
            # Those that failed come first, then those that are stalled.
            behind.sort(key=lambda each: -STATES.index(each[1].state))
            raise RequestRefused(
                HTTPStatus.SERVICE_UNAVAILABLE,
                few(behind, lambda each: f"zone '{each[0].id}' is {each[1].state}: {each[1].reason}"),
                retry_after=RETRY_SECONDS,
                zones=[json.loads(to_json(_readiness(*each))) for each in behind[:MOST_NAMES]],
                zone_count=len(behind),
            )
        shown = tuple(_readiness(*each) for each in every[:MOST_NAMES])
        return json_answer(to_json(ReadyPayload(shown, len(every))))

    exposition: dict[int | str, Any] = {200: {"description": "Prometheus exposition", "content": {"text/plain": {}}}}

    @route(router, "GET /metrics", refused=(), responses=exposition, response_class=Response)
    def metrics(site: Here, request: Request) -> Response:
        """Metrics for Prometheus"""
        # Written in a thread: with many zones it is megabytes, for which the event loop must not wait.
        encode, media_type = choose_encoder(request.headers.get("accept", ""))
        return Response(encode(metrics_registry), headers={"Content-Type": media_type})

    @route(router, "POST /admin/reload", refused=(401, 403, 409, 500), response_model=ReloadPayload)
    async def reload_configuration(site: Here, caller: Asking) -> Response:
        """Read the configuration again; zones that are the same in it go on untouched"""
        who = f"key {caller.name}"
        AUDIT.info("asked to reload the configuration with the API key '%s'", caller.name, extra=about("reload", who))
        try:
            if site.backend.reload is None:
                raise ReloadRefused(["this daemon has no configuration file to read again"])
            done = await site.backend.reload()
        except ReloadRefused as error:
            # The request is right; the file, or what runs, stands against it.
            raise RequestRefused(HTTPStatus.CONFLICT, error.problems, errors=error.problems) from error
        return json_answer(to_json(ReloadPayload(done)))

    return router


def _readiness(zone: ZoneView, status: ZoneStatus) -> ZoneReadiness:
    told = StatusPayload.of(status, None)
    ages = {channel.channel: channel.age_s for channel in told.channels}
    return ZoneReadiness(zone.id, told.state, told.reason, zone.period, told.age_s, ages)
