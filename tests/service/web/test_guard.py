"""Headers for browsers, and the hosts that are answered for."""

import pytest
from fastapi import FastAPI
from support.http_client import get, problem
from support.tables import tabled

from service.config.http import HttpConfig
from service.publish.metrics import Metrics
from service.web.app import create_app


@pytest.fixture(scope="module")
def app() -> FastAPI:
    http = HttpConfig(host="192.0.2.7", behind_tls_proxy=True, allowed_hosts=("thermogate.example",))
    return create_app("htwg", {}, Metrics({}).registry, http=http)


def test_every_answer_is_hardened(app: FastAPI) -> None:
    for path in ("/", "/docs", "/openapi.json", "/zones", "/nowhere", "/static/main.js", "/static/plotly.min.js"):
        headers = get(app, path).headers
        policy = headers["content-security-policy"]
        assert policy.startswith("default-src 'self'; ")
        assert "frame-ancestors 'none'" in policy
        assert not [word for word in ("unsafe-eval", "script-src") if word in policy], "scripts come from here alone"
        named = [headers[f"x-{name}-options"] for name in ("content-type", "frame")]
        assert (*named, headers["referrer-policy"]) == ("nosniff", "DENY", "no-referrer")
        assert headers["cache-control"] == ("no-cache" if "plotly" in path else "no-store")
        assert "server" not in headers


@tabled
def test_a_page_of_another_site_asks_nothing(app: FastAPI, headers: dict[str, str], status: int) -> None:
    """It could not read the answer, but it would take the streams and the turns of whoever looks at it."""
    assert get(app, "/zones", headers=headers).status_code == status


OURS = ("localhost", "LOCALHOST:8080", "localhost.", "127.0.0.1:8080", "[::1]:8080", "[::1]", "192.0.2.7", "10.9.8.7:1")
STRANGE = ("localhost:8080:1", "localhost:x", "[attacker]", ":8080", "attacker.example", "attacker.example:8080")
ALIKE = ("localhost.attacker.example", "127.0.0.1.attacker.example", "thermogate.example.attacker")


def test_only_addresses_and_our_names_are_answered(app: FastAPI) -> None:
    for host in (*OURS, "thermogate.example:443"):
        assert get(app, "/healthz", headers={"Host": host}).status_code == 200, host
    for host in (*STRANGE, *ALIKE):
        assert "http.allowed_hosts" in problem(get(app, "/healthz", headers={"Host": host}), 421)["detail"], host
