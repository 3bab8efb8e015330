"""Health, metrics, errors of the framework, documentation and pages."""

import asyncio
import gzip
import re
import sys
import zlib
from importlib.metadata import version
from pathlib import Path

import pytest
from fastapi import FastAPI
from support.fake_zones import FakeZone, announced, make_update, running
from support.http_client import get, problem, request

from service import web
from service.publish.metrics import Metrics
from service.web.app import create_app
from service.web.server.in_process import ask
from service.web.site import Backend


@pytest.fixture(scope="module")
def zones() -> dict[str, FakeZone]:
    return {zone.id: zone for zone in (running("living"), running("bedroom"))}


@pytest.fixture(scope="module")
def app(zones: dict[str, FakeZone]) -> FastAPI:
    metrics = Metrics(zones)
    metrics.publish(announced("living", make_update(0), running("living").now().status))
    return create_app("htwg", zones, metrics.registry, backend=Backend(version="1.2.3"))


def test_health_says_what_does_not_answer() -> None:
    backend = Backend(problems=lambda: ["the journal has not answered for 61 s"])
    answer = get(create_app("htwg", {}, Metrics({}).registry, backend=backend), "/healthz")
    assert problem(answer, 503)["detail"] == "the journal has not answered for 61 s"
    assert "retry-after" in answer.headers


def test_of_many_zones_that_are_not_ready_the_worst_are_named() -> None:
    zones = {f"room-{k}": running(f"room-{k}") for k in range(500)}
    for k, zone in enumerate(zones.values()):
        if k >= 100:
            zone.state, zone.reason = "waiting", "no complete sample yet"
    zones["room-450"].state, zones["room-499"].state = "stalled", "failed"
    document = problem(get(create_app("htwg", zones, Metrics({}).registry), "/readyz"), 503)
    assert [(zone["id"], zone["state"]) for zone in document["zones"][:3]] == [
        ("room-499", "failed"),
        ("room-450", "stalled"),
        ("room-100", "waiting"),
    ]
    assert (len(document["zones"]), document["zone_count"]) == (20, 400)
    assert document["detail"].startswith("zone 'room-499' is failed: no complete sample yet; zone 'room-450' is ")
    assert document["detail"].endswith("; and 380 more")


def test_metrics_in_both_formats(app: FastAPI) -> None:
    plain = get(app, "/metrics")
    assert plain.headers["content-type"].startswith("text/plain")
    assert 'thermogate_samples_total{zone="living"} 1.0' in plain.text
    assert 'thermogate_zone_state{state="running",zone="bedroom"} 1.0' in plain.text
    modern = get(app, "/metrics", headers={"Accept": "application/openmetrics-text; version=1.0.0"})
    assert modern.headers["content-type"].startswith("application/openmetrics-text")
    assert modern.text.endswith("# EOF\n")


def test_unknown_paths_and_methods_are_problems(app: FastAPI) -> None:
    assert "/docs" in problem(get(app, "/nowhere"), 404)["detail"]
    assert "/docs" in problem(get(app, "/static/nothing.js"), 404)["detail"]
    assert "does not take DELETE" in problem(request(app, "DELETE", "/zones/living"), 405)["detail"]
    assert request(app, "OPTIONS", "/zones/living/forecast").headers["allow"] == "GET, POST", "all of a path's routes"


def test_an_internal_error_tells_the_client_nothing(
    app: FastAPI, zones: dict[str, FakeZone], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zones["living"], "failure", RuntimeError("secret /var/lib path"))
    answer = get(app, "/zones/living/history")
    assert problem(answer, 500)["detail"] == "the daemon failed to answer this request; its log says why"
    assert "secret" not in answer.text
    assert "content-security-policy" in answer.headers, "hardened and counted as any other answer"
    assert app.state.answers["500"] == 1


def test_static_files_stay_in_their_folder(app: FastAPI) -> None:
    for path in ("/../service/api.py", "/%2e%2e/api.py", "/..%2fapi.py", "//etc/passwd"):
        assert get(app, f"/static{path}").status_code == 404, path


def test_the_openapi_document_is_written_while_the_first_clients_ask(zones: dict[str, FakeZone]) -> None:
    paths = ("/openapi.json", "/zones", "/zones/living/forecast", "/openapi.json", "/zones/living/history", "/healthz")

    async def first_minute() -> list[int]:
        fresh = create_app("htwg", zones, Metrics(zones).registry)
        asked = (ask(fresh, "GET", path, headers=[(b"host", b"localhost")]) for path in paths)
        return [answer.status for answer in await asyncio.gather(*asked)]

    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        assert [asyncio.run(first_minute()) for _ in range(5)] == [[200] * len(paths)] * 5
    finally:
        sys.setswitchinterval(usual)


def test_every_described_route_refuses_a_parameter_that_it_does_not_have(app: FastAPI) -> None:
    for path, operations in get(app, "/openapi.json").json()["paths"].items():
        for method in operations:
            answer = request(app, method.upper(), f"{path.replace('{zone}', 'living')}?colour=red", json={})
            if answer.status_code != 401:
                assert "query parameter 'colour' is not known" in problem(answer, 422)["detail"], f"{method} {path}"


@pytest.mark.parametrize("page", ["/", "/docs"])
def test_pages_load_only_what_this_daemon_serves(app: FastAPI, page: str) -> None:
    answer = get(app, page)
    assert answer.headers["content-type"].startswith("text/html")
    assert "default-src 'self'" in answer.headers["content-security-policy"]
    loaded = re.findall(r'(?:src|href)="([^"]+)"', answer.text)
    assert any(path.endswith(".js") for path in loaded)
    for path in loaded:
        assert not path.startswith(("http", "//")), path
        found = get(app, f"/{path.removeprefix('./')}")
        assert found.status_code == 200, path
        if path.endswith(".js"):
            assert "javascript" in found.headers["content-type"]
            for module in re.findall(r'from "\./([^"]+)"', found.text):
                assert get(app, f"/static/{module}").status_code == 200


def test_scripts_name_no_other_host_and_put_no_html_together() -> None:
    scripts = sorted((Path(web.__file__).parent / "static").glob("*.js"))
    assert len(scripts) > 10
    for script in scripts:
        text = script.read_text(encoding="utf-8").replace("http://www.w3.org/2000/svg", "")
        found = r"https?://|innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(|new Function"
        assert not re.findall(found, text), script


def test_plotly_is_served_compressed_and_cached(app: FastAPI) -> None:
    path, installed = "/static/plotly.min.js", version("plotly")
    assert f'data-plotly="{installed}"' in get(app, "/").text, "the page asks for this version"
    answer = get(app, f"{path}?v={installed}")
    assert "plotly.js" in answer.text[:200]
    assert answer.headers["content-encoding"] == "gzip"
    assert answer.headers["cache-control"] == "max-age=31536000, immutable"
    assert get(app, f"{path}?v=0").headers["cache-control"] == "no-cache", "another version is not kept"
    assert get(app, path, headers={"If-None-Match": answer.headers["etag"]}).status_code == 304
    plain = get(app, path, headers={"Accept-Encoding": "identity"})
    assert "content-encoding" not in plain.headers
    assert plain.text == answer.text
    assert plain.headers["vary"] == answer.headers["vary"] == "Accept-Encoding"


def test_plotly_is_packed_once_for_all_clients(app: FastAPI, monkeypatch: pytest.MonkeyPatch) -> None:
    first = get(app, "/static/plotly.min.js")
    for module in (gzip, zlib):
        monkeypatch.delattr(module, "compress")
    monkeypatch.delattr(zlib, "compressobj")
    assert get(app, "/static/plotly.min.js").text == first.text
