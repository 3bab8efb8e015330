"""Requests that the OpenAPI document of a running daemon allows, and many that it does not: an answer as documented,
and never a 5xx but the 503 of a zone that has no forecast."""

import atexit
from functools import cache

import requests
import schemathesis
from fuzz.fuzzing import folder, structured
from hypothesis import strategies as st
from schemathesis.specs.openapi import checks
from schemathesis.specs.openapi.schemas import OpenApiSchema
from support.harness import EXAMPLES, Daemon

CONFORMANCE = [
    checks.status_code_conformance,
    checks.content_type_conformance,
    checks.response_headers_conformance,
    checks.response_schema_conformance,
]
SECONDS = 30


@cache
def document() -> OpenApiSchema:
    """The API of a daemon whose zone has a recording behind it."""
    own = folder()
    text = (EXAMPLES / "generic-csv.toml").read_text(encoding="utf-8")
    config = own / "generic-csv.toml"
    config.write_text(text.replace('files = ["data/', f'files = ["{EXAMPLES}/data/'), encoding="utf-8")
    settings: dict[str, object] = {"site.state_dir": str(own / "state"), "zones.room-1.estimator_options.particles": 50}
    daemon = Daemon(config, own / "log", settings)
    atexit.register(daemon.kill)
    daemon.wait_until_ended()
    return schemathesis.openapi.from_url(f"{daemon.url()}/openapi.json")


@cache
def session() -> requests.Session:
    return requests.Session()


def cases() -> st.SearchStrategy[schemathesis.Case]:
    """Of every operation but the stream, which does not end, what its description allows and what it forbids."""
    operations = [found.ok() for found in document().get_all_operations() if not found.ok().path.endswith("/stream")]
    assert len(operations) >= 8
    modes = (schemathesis.GenerationMode.POSITIVE, schemathesis.GenerationMode.NEGATIVE)
    return st.one_of(*(one.as_strategy(generation_mode=mode) for one in operations for mode in modes))


@structured(examples=100, case=st.deferred(cases), zone=st.sampled_from(["room-1", None]))
def test_request(case: schemathesis.Case, zone: str | None) -> None:
    if zone is not None and "zone" in case.path_parameters:
        case.path_parameters["zone"] = zone
    response = case.call(session=session(), timeout=SECONDS)
    assert response.status_code < 500 or response.status_code == 503, response.text
    case.validate_response(response, checks=CONFORMANCE)
