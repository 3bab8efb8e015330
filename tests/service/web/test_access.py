"""Who may ask what: every route with no key, a wrong one, and each kind of right one."""

import logging
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI
from starlette.routing import Mount, Route
from support.fake_zones import FakeZone, running
from support.http_client import get, problem, request

from service.publish.metrics import Metrics
from service.web import access
from service.web.access import OPEN_PATHS, Asking
from service.web.app import create_app
from service.web.keys import KeyRing, create_key, revoke_key
from service.web.limits import FAILURES, FailedAttempts
from service.web.server.peers import peer_of

READS = ["/zones", "/zones/living", "/zones/living/forecast", "/zones/living/parameters", "/zones/living/history"]
WHOLE = ["/readyz", "/metrics"]
PLAN = {"horizon": "10min"}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "keys.json"


@pytest.fixture
def zones() -> dict[str, FakeZone]:
    return {zone.id: zone for zone in (running("living"), running("bedroom"))}


@pytest.fixture
def app(zones: dict[str, FakeZone], file: Path) -> FastAPI:
    app = create_app("htwg", zones, Metrics(zones).registry, keys=KeyRing(file, required=False))

    @app.post("/admin/greet")
    async def greet(caller: Asking) -> dict[str, str]:
        return {"hello": caller.name}

    return app


def bearer(secret: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {secret}"}


def test_without_keys_reading_is_open_and_administration_closed(app: FastAPI) -> None:
    for path in (*READS, *WHOLE, *OPEN_PATHS):
        assert get(app, path).status_code == 200, path
    answer = request(app, "POST", "/admin/greet")
    assert "needs an API key" in problem(answer, 401)["detail"]
    assert answer.headers["www-authenticate"] == 'Bearer realm="thermogate"'


def test_every_route_is_closed_but_the_open_ones(app: FastAPI, file: Path) -> None:
    create_key(file, "one", "read")
    assert not [route for route in app.routes if isinstance(route, Mount)], "what is mounted cannot be listed"
    described = [(path, method.upper()) for path, item in app.openapi()["paths"].items() for method in item]
    own = [(route.path, method) for route in app.routes if isinstance(route, Route) for method in route.methods or ()]
    for path, method in (*described, *own):
        answer = request(app, method, path.replace("{zone}", "living"))
        assert (answer.status_code != 401) == (path in OPEN_PATHS or path.startswith("/static/")), f"{method} {path}"
    named = {"/zones/{zone}/history", "/metrics", "/admin/greet", "/docs", "/static/plotly.min.js"}
    assert {path for path, _ in (*described, *own)} >= named


def test_a_read_key_asks_for_planned_forecasts_but_administers_nothing(app: FastAPI, file: Path) -> None:
    reader, admin = bearer(create_key(file, "reader", "read")), bearer(create_key(file, "boss", "admin"))
    assert request(app, "POST", "/zones/living/forecast", json=PLAN, headers=reader).status_code == 200
    answer = request(app, "POST", "/admin/greet", headers=reader)
    assert "key for admin" in problem(answer, 403)["detail"]
    assert 'error="insufficient_scope"' in answer.headers["www-authenticate"]
    assert request(app, "POST", "/admin/greet", headers=admin).json() == {"hello": "boss"}
    for path in (*READS, *WHOLE):
        assert get(app, path, headers=admin).status_code == 200
    for path in ("/admin", "/admin/nowhere"):
        assert get(app, path, headers=reader).status_code == 403


def test_a_key_for_one_zone_knows_of_no_other(app: FastAPI, zones: dict[str, FakeZone], file: Path) -> None:
    tenant = bearer(create_key(file, "tenant", "read", ["living", "gone"]))
    for path in READS:
        assert get(app, path, headers=tenant).status_code == 200, path
    for path in ("/zones", "/overview"):
        assert [zone["id"] for zone in get(app, path, headers=tenant).json()["zones"]] == ["living"]
    for path in ("/zones/bedroom", "/zones/bedroom/forecast", "/zones/attic", "/zones/gone", "/zones/%62edroom"):
        answer = get(app, path, headers=tenant)
        document = problem(answer, 404)
        name = answer.request.url.path.split("/")[2]
        assert document["detail"].startswith(f"there is no zone '{name}'; the zones are ")
        assert "bedroom" not in document["zones"]
    assert request(app, "POST", "/zones/bedroom/forecast", json=PLAN, headers=tenant).status_code == 404
    for path in (*WHOLE, "/nowhere"):
        assert "for all zones" in problem(get(app, path, headers=tenant), 403)["detail"]
    assert not zones["bedroom"].asked


@pytest.mark.parametrize("header", ["tg_x", "Basic dXNlcjpwYXNz", "Bearer", "Bearer ", "", "bearer tg_ä"])
def test_what_is_no_right_key_is_refused(app: FastAPI, file: Path, header: str) -> None:
    secret = create_key(file, "one", "read")
    problem(get(app, "/zones", headers={"Authorization": header.encode("latin-1")}), 401)
    assert get(app, "/zones", headers={"Authorization": f"bearer  {secret}"}).status_code == 200, "in any case"
    revoke_key(file, "one")
    answer = get(app, "/zones", headers=bearer(secret))
    assert "wrong, revoked or expired" in problem(answer, 401)["detail"]
    assert 'error="invalid_token"' in answer.headers["www-authenticate"]


async def test_guessing_is_slowed_down_noted_and_does_not_lock_others_out(
    app: FastAPI, file: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(access, "HOLD_SECONDS", 0.001)
    secret, transport = create_key(file, "one", "read"), httpx.ASGITransport(app, client=("10.0.0.5", 1234))
    caplog.set_level(logging.INFO)
    async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
        wrong = [await client.get("/zones", headers=bearer(f"tg_guess-{number}")) for number in range(30)]
        right = await client.get("/zones", headers=bearer(secret))
    assert [answer.status_code for answer in wrong] == [401] * FAILURES + [429] * (30 - FAILURES)
    assert 1 <= int(wrong[-1].headers["retry-after"]) <= 60
    assert right.status_code == 200
    about = [record.getMessage() for record in caplog.records if "10.0.0.5" in record.getMessage()]
    assert len(about) == 2, "a line for the first and one for too many"
    assert not [said for said in ("guess", secret) if said in caplog.text]


def test_failed_attempts_are_forgiven_in_time() -> None:
    now = [0.0]
    attempts = FailedAttempts(lambda: now[0])
    assert [attempts.count("a") for _ in range(FAILURES)] == [0] * FAILURES
    assert attempts.count("a") == 6
    assert attempts.count("b") == 0, "each peer has its own"
    now[0] = 6.0
    assert attempts.count("a") == 0
    assert attempts.count("a") > 0
    for number in range(5000):
        attempts.count(f"peer-{number}")
    assert len(attempts._allowed._clients) <= 1024, "the table is bounded"


PEERS = {"10.0.0.5": "10.0.0.5", "2001:db8:1:2:3:4:5:6": "2001:db8:1:2::/64", "::ffff:10.0.0.5": "10.0.0.5"}


@pytest.mark.parametrize(("host", "peer"), [*PEERS.items(), ("x" * 10_000, "x" * 64), (None, "unknown")])
def test_a_peer_is_its_address(host: str | None, peer: str) -> None:
    assert peer_of({"type": "http", "client": None if host is None else (host, 1)}) == peer


def test_while_nobody_can_say_which_keys_are_good_none_is(app: FastAPI, file: Path) -> None:
    known = bearer(create_key(file, "one", "read"))
    assert get(app, "/zones", headers=known).status_code == 200
    content = file.read_bytes()
    file.write_bytes(b"{")
    answer = get(app, "/zones", headers=known)
    assert "cannot be read now" in problem(answer, 503)["detail"]
    assert str(file) not in answer.text
    assert int(answer.headers["retry-after"]) > 0
    assert get(app, "/zones").status_code == 401
    assert [get(app, "/healthz", headers=headers).json()["version"] for headers in ({}, known)] == [None, None]
    file.write_bytes(content)
    assert [get(app, "/healthz", headers=headers).json()["version"] for headers in ({}, known)] == [None, "unknown"]
