"""The daemon as a process of its own, driven from tests over its public interfaces."""

import io
import json
import os
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from support.processes import THERMOGATE, Program, fetch
from support.waiting import wait_until

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "deploy" / "examples"
PACKAGES = ("estimator", "adapters", "service", "replay", "thermogate")
SHARED = ROOT.parent / "shared" / "data"
FLEXHOUSE = SHARED / "flexhouse_prbs1" / "inputPRBS1.csv"
# A script's background has Ctrl-C ignored, which its processes inherit.
_HEEDING = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)"
INTERRUPTIBLE = [sys.executable, "-c", f"{_HEEDING}; from service.cli.main import main; sys.exit(main())"]
"""`thermogate` as a process that Ctrl-C ends wherever it was started."""


def thermogate(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, in this process, which has imported everything already."""
    from service.cli.main import main

    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = main([*map(str, arguments)])
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def python(code: str, **environment: str | None) -> str:
    """What a fresh interpreter prints, in which warnings are errors; None takes a variable away."""
    own = {name: value for name, value in (os.environ | environment).items() if value is not None}
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, cwd=ROOT, env=own)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def overrides(settings: dict[str, object]) -> list[str]:
    """`--set` options; values in TOML's notation, of which JSON's is a part for what tests use."""
    return [word for key, value in settings.items() for word in ("--set", f"{key}={json.dumps(value)}")]


def ask(
    url: str, content: bytes | None = None, key: str | None = None, timeout: float = 180, **headers: str
) -> tuple[int, dict]:
    """Status and JSON body of the answer to a GET, or to a POST of `content`; see `fetch`."""
    if key:
        headers["Authorization"] = f"Bearer {key}"
    status, text = fetch(url, content, timeout=timeout, **headers)
    return status, json.loads(text)


class Daemon(Program):
    """`thermogate run` on a free port."""

    def __init__(self, config: Path, log: Path, settings: dict[str, object] | None = None, *options: str) -> None:
        chosen = {"http.port": 0, "zenoh.enabled": False} | (settings or {})
        self.key: str | None = None
        """An API key for `get`."""
        log.unlink(missing_ok=True)
        command = [THERMOGATE, "run", config, *overrides(chosen), *options]
        super().__init__(command, log, env=os.environ | {"PYTHONUNBUFFERED": "1"})

    def url(self) -> str:
        """The address it serves on, once it does."""
        return self.says(r"serving on (https?://\S+)")[1]

    def get(self, path: str) -> tuple[int, dict]:
        """Status and JSON body of a GET."""
        return ask(self.url() + path, key=self.key)

    def text(self, path: str) -> str:
        """Body of a GET that is no JSON."""
        headers = {"Authorization": f"Bearer {self.key}"} if self.key else {}
        return fetch(self.url() + path, **headers)[1]

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

    def history(self, zone: str) -> list[dict]:
        """Every history row of a zone."""
        status, body = self.get(f"/zones/{zone}/history?limit=20000")
        assert status == 200, body
        return body["rows"]


def ended(zones: dict) -> bool:
    """Whether the recordings of `zones` have come to their ends."""
    return all("come to an end" in zone["reason"] for zone in zones.values())


def reload(daemon: Daemon, expected: str) -> None:
    """Send SIGHUP and wait until the log says `expected` once more."""
    before = daemon.log().count(expected)
    daemon.process.send_signal(signal.SIGHUP)
    daemon.wait_for(lambda: daemon.log().count(expected) > before)
