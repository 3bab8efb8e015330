"""The daemon as a process of its own, driven from tests over its public interfaces."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from support.waiting import wait_until

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "deploy" / "examples"
SHARED = ROOT.parent / "shared" / "data"
THERMOGATE = Path(sys.executable).with_name("thermogate")
FLEXHOUSE = SHARED / "flexhouse_prbs1" / "inputPRBS1.csv"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def thermogate(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, in this process, which has imported everything already."""
    from service.cli.main import main

    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = main([*map(str, arguments)])
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def overrides(settings: dict[str, object]) -> list[str]:
    """`--set` options; values in TOML's notation, of which JSON's is a part for what tests use."""
    return [word for key, value in settings.items() for word in ("--set", f"{key}={json.dumps(value)}")]


def ask(
    url: str, content: bytes | None = None, key: str | None = None, timeout: float = 180, **headers: str
) -> tuple[int, dict]:
    """Status and JSON body of the answer to a GET, or to a POST of `content`; `_` in the name of a header is `-`."""
    sent = {name.replace("_", "-"): value for name, value in headers.items()}
    if key:
        sent["Authorization"] = f"Bearer {key}"
    try:
        with urllib.request.urlopen(urllib.request.Request(url, content, sent), timeout=timeout) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, json.load(error)


class Daemon:
    """`thermogate run` on a free port; a context manager that never leaves a process behind."""

    def __init__(self, config: Path, log: Path, settings: dict[str, object] | None = None, *options: str) -> None:
        chosen = {"http.port": 0, "zenoh.enabled": False} | (settings or {})
        self._log = log
        self.key: str | None = None
        """An API key for `get`."""
        command = [str(THERMOGATE), "run", str(config), *overrides(chosen), *options]
        with log.open("w") as stream:
            self.process = subprocess.Popen(
                command, stdout=stream, stderr=stream, env=os.environ | {"PYTHONUNBUFFERED": "1"}
            )

    def __enter__(self) -> Daemon:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def log(self) -> str:
        return self._log.read_text()

    def url(self) -> str:
        """The address it serves on, once it does."""

        def serving() -> re.Match[str] | None:
            said = self.log()
            if (found := re.search(r"serving on (https?://\S+)", said)) is None:
                assert self.process.poll() is None, said
            return found

        return wait_until(serving, self.log).group(1)

    def get(self, path: str) -> tuple[int, dict]:
        """Status and JSON body of a GET."""
        return ask(self.url() + path, key=self.key)

    def text(self, path: str) -> str:
        """Body of a GET that is no JSON."""
        with urllib.request.urlopen(self.url() + path, timeout=180) as answer:
            return answer.read().decode()

    def post(self, path: str, body: dict) -> tuple[int, dict]:
        """Status and JSON body of a POST."""
        return ask(self.url() + path, json.dumps(body).encode(), self.key, Content_Type="application/json")

    def wait(self, done, timeout: float = 240) -> dict:
        """Poll /zones until `done(zones by id)`."""

        def zones() -> dict:
            assert self.process.poll() is None, self.log()
            return {zone["id"]: zone for zone in self.get("/zones")[1]["zones"]}

        return wait_until(
            lambda: found if done(found := zones()) else None, lambda: f"{zones()}; {self.log()}", timeout
        )

    def status(self, zone: str) -> dict:
        """How a zone is doing."""
        return self.get(f"/zones/{zone}")[1]["status"]

    def until(self, zone: str, done) -> dict:
        """The status of a zone, once that is `done`."""
        told = lambda: f"{self.status(zone)}; {self.log()}"  # noqa: E731
        return wait_until(lambda: found if done(found := self.status(zone)) else None, told, 240)

    def wait_until_ended(self) -> dict:
        """Until every zone's recording has come to its end, which takes as long as it takes while zones go on."""
        samples = -1
        while True:
            zones = self.wait(
                lambda zones, before=samples: ended(zones) or sum(zone["samples"] for zone in zones.values()) > before
            )
            if ended(zones):
                return zones
            samples = sum(zone["samples"] for zone in zones.values())

    def terminate(self, signum: int = signal.SIGTERM) -> int:
        """Exit code after an orderly stop, which may take as long as on a very busy machine."""
        self.process.send_signal(signum)
        return self.process.wait(timeout=180)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def history(self, zone: str) -> list[dict]:
        """Every history row of a zone."""
        status, body = self.get(f"/zones/{zone}/history?limit=20000")
        assert status == 200, body
        return body["rows"]


def ended(zones: dict) -> bool:
    """Whether the recordings of `zones` have come to their ends."""
    return all("come to an end" in zone["reason"] for zone in zones.values())


def reload(daemon: Daemon, expected: str, timeout: float = 240) -> None:
    """Send SIGHUP and wait until the log says `expected` once more."""
    before = daemon.log().count(expected)
    daemon.process.send_signal(signal.SIGHUP)

    def again() -> bool:
        assert daemon.process.poll() is None, daemon.log()
        return daemon.log().count(expected) > before

    wait_until(again, daemon.log, timeout)
