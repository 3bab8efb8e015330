"""Everything that goes wrong over REST, as application/problem+json (RFC 9457) in sentences."""

import re
import reprlib
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from http import HTTPStatus
from typing import Any, get_args, get_origin

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException
from starlette.routing import Match

from adapters.fields.problems import extended, own_sentence
from service.errors import RequestError, ServiceError, TooManyQuestions
from service.web.models import EXAMPLES
from service.web.server.refusal import FAILED, MEDIA_TYPE, RequestRefused, few

RETRY_SECONDS = 60
SOON_SECONDS = 5

_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60


class Problem(BaseModel, json_schema_extra={"examples": EXAMPLES["Problem"]}):
    """An error (RFC 9457)."""

    type: str = "about:blank"
    title: str
    status: int
    detail: str = Field(description="what is wrong, and what to do about it")
    errors: list[str] | None = Field(default=None, description="422 and 409: one sentence per mistake")
    zones: list[Any] | None = Field(
        default=None, description="404: known zones; 503 of /readyz: zones that are not ready; 20 at most"
    )
    zone_count: int | None = Field(default=None, description="how many such zones there are, beside `zones`")


def invalid(mistakes: Sequence[Any], tell: Callable[[Any], str] = str) -> RequestRefused:
    """A request with mistakes, one sentence each, as `tell` puts it."""
    told = few(mistakes, tell)
    return RequestRefused(HTTPStatus.UNPROCESSABLE_ENTITY, told, errors=told)


def documented(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The `responses` of a route that may answer with problems of these `statuses`."""
    return {status: problem_response(HTTPStatus(status).phrase) for status in statuses}


def problem_response(description: str) -> dict[str, Any]:
    """A problem in the OpenAPI document."""
    schema = {"$ref": "#/components/schemas/Problem"}
    return {"description": description, "content": {MEDIA_TYPE: {"schema": schema}}}


async def known_parameters(request: Request) -> None:
    """Dependency of every described route: RequestRefused for query parameters that it has not, or only once, for what
    is misspelt or given again would otherwise be ignored; and for numbers as Python writes them."""
    known = {one.alias: one.field_info.annotation for one in request.scope["route"].dependant.query_params}
    mistakes = []
    for name in sorted(request.query_params.keys()):
        values, kind = request.query_params.getlist(name), known.get(name)
        if name not in known:
            mistakes.append(f"query parameter '{name}' is not known; /docs lists the known ones")
        elif len(values) > 1 and get_origin(kind) is not list:
            mistakes.append(f"query parameter '{name}' is given {len(values)} times; give it once")
        elif str not in (kind, *get_args(kind)):
            wrong = [value for value in values if "_" in value]
            mistakes += [f"query parameter '{name}' must be without '_', not {_SHORT.repr(value)}" for value in wrong]
    if mistakes:
        raise invalid(mistakes)


def install(app: FastAPI) -> None:
    """Make `app` answer every error with a problem document."""
    for kind in (ServiceError, RequestValidationError, HTTPException, Exception):
        app.add_exception_handler(kind, _answer)


async def _answer(request: Request, error: Exception) -> Response:
    return _refusal(request, error).answer


def _refusal(request: Request, error: Exception) -> RequestRefused:
    match error:
        case RequestRefused():
            return error
        # What goes wrong while the framework takes a body in, it makes a mistake of its own.
        case HTTPException(__cause__=RequestRefused() as cause):
            return cause
        case RequestError():
            return invalid(error.problems)
        case TooManyQuestions():
            return RequestRefused(HTTPStatus.TOO_MANY_REQUESTS, [str(error)], SOON_SECONDS)
        case ServiceError():
            return RequestRefused(HTTPStatus.SERVICE_UNAVAILABLE, [str(error)], RETRY_SECONDS)
        case RequestValidationError():
            # Only those that are told are put into words.
            return invalid(error.errors(), sentence_of)
        case HTTPException():
            path, headers, detail = request.url.path, dict(error.headers or {}), str(error.detail)
            if error.status_code == HTTPStatus.NOT_FOUND:
                detail = f"there is nothing at {path}; /docs lists what there is"
            elif error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
                detail = f"{path} does not take {request.method}; /docs lists what it takes"
                # The framework names those of the first route with this path.
                headers["Allow"] = ", ".join(_allowed(request))
            return RequestRefused(error.status_code, [detail], headers=headers)
    return FAILED


def _allowed(request: Request) -> list[str]:
    """The methods that the path of `request` takes."""
    methods = {"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE"}
    router = request.app.router
    asked = ((method, {**request.scope, "method": method}) for method in methods)
    return sorted(
        method for method, scope in asked if any(route.matches(scope)[0] is Match.FULL for route in router.routes)
    )


def sentence_of(detail: Mapping[str, Any]) -> str:
    """One validation error of pydantic as a sentence that begins with its place."""
    kind, place, sentence = detail["type"], _place(detail["loc"]), own_sentence(detail)
    if sentence is not None:
        return f"{place}: {sentence}"
    if kind == "json_invalid":
        return f"the body is not JSON: {detail['ctx']['error']}"
    if kind == "missing":
        return f"{place} is missing"
    if kind == "extra_forbidden":
        return f"{place} is not known; /docs lists the known ones"
    if kind == "too_long":
        return f"{place} takes at most {detail['ctx']['max_length']} values"
    if kind == "too_short":
        return f"{place} needs at least {detail['ctx']['min_length']} values"
    if isinstance(detail["input"], bytes):
        return "the body was not sent as JSON; set Content-Type: application/json"
    wanted = re.sub("^(Input|String) should", "must", detail["msg"]).split(", unable")[0]
    return f"{place} {wanted}, not {_shown(detail['input'])}"


def _place(location: Sequence[str | int]) -> str:
    kind, *path = location
    if not path:
        return "the JSON body"
    name = reduce(extended, path[1:], str(path[0]))
    return f"query parameter '{name}'" if kind == "query" else f"field '{name}'"


def _shown(value: object) -> str:
    text = _SHORT.repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
