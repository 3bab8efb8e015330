"""Home Assistant itself, as a process of its own, set up and asked over its REST interface as its own pages do."""

import json
import os
import subprocess
import sys
import urllib.parse
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from support.processes import Program, fetch, free_port

HOME = Path(os.environ.get("THERMOGATE_HOME_ASSISTANT", Path(sys.prefix) / "home-assistant"))
"""Where `make home-assistant` installs it."""

_CLIENT = "http://127.0.0.1/"
_SETTINGS = Path(__file__).with_name("home-assistant.yaml").read_text(encoding="utf-8")


def clean() -> dict[str, str]:
    """The environment without what is ours: it is another application, with another interpreter's packages."""
    return {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "COVERAGE"))}


class HomeAssistant(Program):
    """A running Home Assistant, whose owner is us."""

    def __init__(self, folder: Path, settings: str = "") -> None:
        """`settings` are added to its configuration.yaml."""
        if not (HOME / "installed").exists():
            pytest.skip("Home Assistant is not installed; make home-assistant installs it")
        port = free_port()
        self.url = f"http://127.0.0.1:{port}"
        self._token = ""
        folder.mkdir(exist_ok=True)
        (folder / "configuration.yaml").write_text(_SETTINGS.format(port=port) + settings, encoding="utf-8")
        command = [HOME / "bin" / "hass", "--skip-pip", "--config", folder]
        super().__init__(command, folder / "home-assistant.log.txt", env=clean())

    def __exit__(self, *_: object) -> None:
        self.process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(timeout=60)
        self.kill()

    def until(self, found: Callable[[], Any]) -> Any:
        """What `found` returns, as soon as that is true; whatever cannot be had yet is waited for."""

        def had() -> Any:
            with suppress(OSError, KeyError, ValueError):
                return found()

        return self.wait_for(had)

    def ask(self, path: str, body: object = None, form: bool = False) -> Any:
        """The answer to a GET, or with `body` to a POST."""
        headers = {"Authorization": f"Bearer {self._token}"} if self._token else {}
        data = None
        if body is not None:
            headers["Content-Type"] = "application/x-www-form-urlencoded" if form else "application/json"
            data = (urllib.parse.urlencode(body) if form else json.dumps(body)).encode()  # type: ignore[arg-type]
        status, text = fetch(self.url + path, data, **headers)
        if status >= 300:
            raise OSError(f"{path}: {status} {text}; {self.log()}")
        with suppress(ValueError):
            return json.loads(text)
        return text

    def own(self) -> None:
        """Become its owner."""
        self.until(lambda: self.ask("/api/onboarding"))
        owner = {"client_id": _CLIENT, "name": "T", "username": "t", "password": "test-only", "language": "en"}
        code = self.ask("/api/onboarding/users", owner)["auth_code"]
        grant = {"grant_type": "authorization_code", "code": code, "client_id": _CLIENT}
        self._token = self.ask("/auth/token", grant, form=True)["access_token"]

    def set_up(self, broker_port: int) -> None:
        """Become its owner, and add the broker as a person does under Settings, Devices & services."""
        self.own()
        flow = self.ask("/api/config/config_entries/flow", {"handler": "mqtt"})
        done = self.ask(
            f"/api/config/config_entries/flow/{flow['flow_id']}", {"broker": "127.0.0.1", "port": broker_port}
        )
        assert done["type"] == "create_entry", done

    def states(self) -> dict[str, dict[str, Any]]:
        """Every entity by its id, with state and attributes."""
        return {entity["entity_id"]: entity for entity in self.ask("/api/states")}

    def state(self, entity: str) -> str:
        """The state of an entity; KeyError as long as there is none."""
        return str(self.states()[entity]["state"])

    def render(self, template: str) -> str:
        """What a template says."""
        return str(self.ask("/api/template", {"template": template}))

    def call(self, domain: str, service: str, **data: object) -> None:
        """Call a service."""
        self.ask(f"/api/services/{domain}/{service}", data)
