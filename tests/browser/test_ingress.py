"""The page within Home Assistant: in a frame, below a path of the Supervisor's, through the add-on's proxy."""

import subprocess
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.request import Request, urlopen

import pytest
from support.browser import eventually
from support.building import building
from support.fake_zones import running
from support.harness import ROOT
from support.processes import free_port, program
from support.waiting import PATIENCE, wait_until

PREFIX = "/api/hassio_ingress/a-token/"


class Ingress(BaseHTTPRequestHandler):
    """The Supervisor: it takes its path away and shows the rest in a frame, under the name of Home Assistant."""

    proxy = 0

    def do_GET(self) -> None:
        if self.path == "/":
            return self._tell(200, "text/html", f'<iframe src="{PREFIX}" width="1000" height="700"></iframe>'.encode())
        if not self.path.startswith(PREFIX):
            return self._tell(404, "text/plain", b"not below the path of ingress")
        headers = {"Host": "homeassistant.local:8123", "X-Ingress-Path": PREFIX.rstrip("/")}
        address = f"http://127.0.0.1:{self.proxy}/{self.path.removeprefix(PREFIX)}"
        with urlopen(Request(address, headers=headers), timeout=PATIENCE) as answer:
            policy = {name: answer.headers[name] for name in ("Content-Security-Policy", "X-Frame-Options")}
            self.send_response(answer.status)
            for name, value in ({"Content-Type": answer.headers["Content-Type"]} | policy).items():
                if value is not None:
                    self.send_header(name, value)
            self.end_headers()
            while piece := answer.read1():
                self.wfile.write(piece)

    def _tell(self, status: int, kind: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def home_assistant(tmp_path: Path) -> Iterator[str]:
    """The address of a Home Assistant whose add-on serves one room."""
    nginx = program("nginx", "nginx-light")
    shipped = (ROOT / "deploy" / "home-assistant" / "addon" / "thermogate" / "nginx.conf").read_text(encoding="utf-8")
    assert "allow 172.30.32.2;\n    deny all;" in shipped
    Ingress.proxy = free_port()
    with building({"living": running("living", 300)}) as served:
        changes = {"8099": f"127.0.0.1:{Ingress.proxy}", "172.30.32.2": "127.0.0.1", "/tmp/": f"{tmp_path}/"}
        changes["http://127.0.0.1:8080"] = served.url
        for old, new in changes.items():
            assert old in shipped
            shipped = shipped.replace(old, new)
        (tmp_path / "nginx.conf").write_text(shipped)
        with subprocess.Popen([nginx, "-c", tmp_path / "nginx.conf", "-g", "daemon off;"]) as proxy:
            with ThreadingHTTPServer(("127.0.0.1", 0), Ingress) as supervisor:
                supervisor.daemon_threads = True
                supervisor.block_on_close = False
                Thread(target=supervisor.serve_forever, daemon=True).start()
                wait_until((tmp_path / "nginx.pid").exists)
                yield f"http://127.0.0.1:{supervisor.server_port}"
                supervisor.shutdown()
            proxy.terminate()


def test_the_page_lives_in_the_frame_of_home_assistant(visit: Any, home_assistant: str) -> None:
    watched = visit(home_assistant, quiet=False)
    (frame,) = watched.page.frames[1:]
    eventually(frame, "document.querySelector('#view')?.innerText.includes('living')")
    frame.evaluate("location.hash = '#/zone/living'")
    eventually(frame, "document.querySelectorAll('.js-plotly-plot .scatterlayer').length >= 2")
    asked = [url.removeprefix(home_assistant) for url in watched.requests]
    assert [path for path in asked if not path.startswith(PREFIX)] in (["/"], ["/", "/favicon.ico"])
    assert not [one for one in watched.complaints if "404" not in one], watched.complaints
