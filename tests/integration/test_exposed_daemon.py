"""The daemon for other machines: refused until it has a key, and no secret gets out."""

import ssl
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from support import sites
from support.certificates import make_pair
from support.harness import Daemon, overrides, thermogate
from support.zenoh_plant import endpoint

MARK = "MARKER-of-a-secret"
ENVIRONMENT = "THERMOGATE_TEST_PASSWORD"


def test_no_secret_gets_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pair = make_pair(tmp_path)
    (tmp_path / "password").write_text(f"{MARK}-password-file")
    (tmp_path / "users").write_text(f"bms:{MARK}-users-file\n")
    monkeypatch.setenv(ENVIRONMENT, f"{MARK}-environment")
    # Two Zenoh sources that nobody answers, each with its own kind of password: their complaints are in the log.
    account = {"user": "thermogate", "password_file": "password"}
    file = {"kind": "zenoh", "connect": [endpoint()], "timeout": 0.2, **account}
    listening = {"kind": "zenoh", "mode": "peer", "listen": [endpoint()], "users_file": "users", "writers": ["bms"]}
    env = {"user": "thermogate", "password_env": ENVIRONMENT} | listening
    zones = [
        sites.zone(zone, source, {name: {"key": f"bms/{zone}/{name}"} for name in sites.UNITS}, period="5min")
        for zone, source in (("living", "file"), ("bedroom", "env"))
    ]
    ours = {"listen": [endpoint()], "users_file": "users", **account}
    config = sites.written(tmp_path, {"file": file, "env": env}, zones, zenoh=ours)
    settings: dict[str, object] = {
        "zenoh.enabled": True,
        "http.host": "0.0.0.0",
        "http.certificate": str(pair.certificate),
        "http.private_key": str(pair.private_key),
    }
    refused = thermogate("run", config, *overrides(settings))
    assert (refused.returncode, "no valid API key" in refused.stderr) == (2, True), "there is no key yet"
    made = thermogate("keys", "create", config, "boss", "--scope", "admin", *overrides(settings))
    assert made.returncode == 0, made.stderr
    admin = made.stdout.strip()
    trust = ssl.create_default_context(cafile=pair.certificate)

    def ask(path: str, secret: str, method: str = "GET") -> str:
        """Head and text of an answer."""
        url = daemon.url().replace("0.0.0.0", "127.0.0.1") + path
        request = urllib.request.Request(url, headers={"Authorization": f"Bearer {secret}"}, method=method)
        try:
            with urllib.request.urlopen(request, timeout=180, context=trust) as answer:
                return answer.read().decode()
        except urllib.error.HTTPError as error:
            with error:
                return str(error.headers) + error.read().decode()

    secrets = [MARK, admin, admin.removeprefix("tg_")]
    secrets += [line for line in pair.private_key.read_text().splitlines() if "PRIVATE" not in line]
    paths = ["/", "/docs", "/openapi.json", "/healthz", "/readyz", "/metrics", "/zones", "/nowhere", "/admin/reload"]
    paths += [f"/zones/living{rest}" for rest in ("", "/forecast", "/parameters", "/history", "/history?limit=x")]
    with Daemon(config, tmp_path / "log", settings) as daemon:
        answers = {path: ask(path, admin) for path in paths}
        answers |= {f"wrong key {path}": ask(path, "tg_" + MARK) for path in paths}
        answers |= {f"POST {path}": ask(path, admin, "POST") for path in paths}
        for words in (["check"], ["show-config"], ["probe", "--seconds", "0.3", "--debug"], ["keys", "list"]):
            done = thermogate(*words, config, *overrides(settings))
            answers[words[0]] = done.stdout + done.stderr
        assert "living" in answers["check"]
        assert "password_file" in answers["show-config"]
        daemon.says("trying again")
        answers["log"] = daemon.log()
    assert "sources.file: no Zenoh session" in answers["log"], "a source has complained"
    assert "wrong API key" in answers["log"]
    for place, text in answers.items():
        for secret in secrets:
            assert secret not in text, f"{place} tells a secret"
