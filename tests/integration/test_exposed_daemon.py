"""The daemon for other machines: refused until safe, keys and certificates change while it runs, no secret gets out."""

from __future__ import annotations

import os
import ssl
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
import tomli_w
from support.certificates import Pair, make_pair
from support.harness import Daemon, free_port, overrides, thermogate
from support.waiting import wait_until

MARK = "MARKER-of-a-secret"
ENVIRONMENT = "THERMOGATE_TEST_PASSWORD"


class Site(NamedTuple):
    """A daemon on every address of this machine, and what it was started with."""

    daemon: Daemon
    config: Path
    settings: dict[str, object]
    pair: Pair
    admin: str

    def ask(self, path: str, secret: str | None = None, method: str = "GET") -> tuple[int, str]:
        """Status and text of an answer; `secret` is sent as a key."""
        url = self.daemon.url().replace("0.0.0.0", "127.0.0.1") + path
        headers = {} if secret is None else {"Authorization": f"Bearer {secret}"}
        request = urllib.request.Request(url, headers=headers, method=method)
        trust = ssl.create_default_context(cafile=self.pair.certificate)
        try:
            with urllib.request.urlopen(request, timeout=180, context=trust) as answer:
                return answer.status, answer.read().decode()
        except urllib.error.HTTPError as error:
            with error:
                return error.code, str(error.headers) + error.read().decode()


def keys(config: Path, settings: dict[str, object], *words: str) -> str:
    """stdout of `thermogate keys`."""
    action, *rest = words
    done = thermogate("keys", action, config, *rest, *overrides(settings))
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("site")
    pair = make_pair(folder)
    (folder / "password").write_text(f"{MARK}-password-file")
    (folder / "users").write_text(f"bms:{MARK}-users-file\n")
    os.environ[ENVIRONMENT] = f"{MARK}-environment"
    # Two Zenoh sources that nobody answers, each with its own kind of password: their complaints are in the log.
    channels = ("T_i", "T_out", "u_heat")
    units = {"T_i": "degC", "T_out": "degC", "u_heat": "W"}
    tables = {
        "site": {"id": "house", "state_dir": str(folder / "state")},
        "zenoh": {
            "listen": [f"tcp/127.0.0.1:{free_port()}"],
            "users_file": "users",
            "user": "thermogate",
            "password_file": "password",
        },
        "sources": {
            "file": {
                "kind": "zenoh",
                "connect": [f"tcp/127.0.0.1:{free_port()}"],
                "timeout": 0.2,
                "user": "thermogate",
                "password_file": "password",
            },
            "env": {
                "kind": "zenoh",
                "mode": "peer",
                "listen": [f"tcp/127.0.0.1:{free_port()}"],
                "user": "thermogate",
                "password_env": ENVIRONMENT,
                "users_file": "users",
                "writers": ["bms"],
            },
        },
        "zones": [
            {
                "id": zone,
                "period": "5min",
                "network": "titeth",
                "estimator_options": {"particles": 100},
                "channels": {
                    name: {"source": source, "key": f"bms/{zone}/{name}", "unit": units[name]} for name in channels
                },
            }
            for zone, source in (("living", "file"), ("bedroom", "env"))
        ],
    }
    config = folder / "site.toml"
    config.write_text(tomli_w.dumps(tables))
    settings: dict[str, object] = {
        "zenoh.enabled": True,
        "http.host": "0.0.0.0",
        "http.certificate": str(pair.certificate),
        "http.private_key": str(pair.private_key),
    }
    refused = thermogate("run", config, *overrides(settings))
    assert refused.returncode == 2, "there is no key yet"
    assert "no valid API key" in refused.stderr
    admin = keys(config, settings, "create", "boss", "--scope", "admin")
    with Daemon(config, folder / "log", settings) as daemon:
        yield Site(daemon, config, settings, pair, admin)
    del os.environ[ENVIRONMENT]


def test_no_secret_gets_out(site: Site) -> None:
    secrets = [MARK, site.admin, site.admin.removeprefix("tg_")]
    secrets += [line for line in site.pair.private_key.read_text().splitlines() if "PRIVATE" not in line]
    paths = ["/", "/docs", "/openapi.json", "/healthz", "/readyz", "/metrics", "/zones", "/nowhere", "/admin/reload"]
    paths += [f"/zones/living{rest}" for rest in ("", "/forecast", "/parameters", "/history", "/history?limit=x")]
    answers = {path: site.ask(path, site.admin)[1] for path in paths}
    answers |= {f"wrong key {path}": site.ask(path, "tg_" + MARK)[1] for path in paths}
    answers |= {f"POST {path}": site.ask(path, site.admin, "POST")[1] for path in paths}
    for words in (["check"], ["show-config"], ["probe", "--seconds", "0.3", "--debug"], ["keys", "list"]):
        done = thermogate(*words, site.config, *overrides(site.settings))
        answers[words[0]] = done.stdout + done.stderr
    assert "living" in answers["check"]
    assert "password_file" in answers["show-config"]
    wait_until(lambda: "trying again" in site.daemon.log(), site.daemon.log)
    answers["log"] = site.daemon.log()
    assert "sources.file: no Zenoh session" in answers["log"], "a source has complained"
    assert "wrong API key" in answers["log"]
    for place, text in answers.items():
        for secret in secrets:
            assert secret not in text, f"{place} tells a secret"
