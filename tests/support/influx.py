"""A real InfluxDB or VictoriaMetrics of a test's own."""

import urllib.parse
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from support.processes import Program, fetch, free_port, program
from support.waiting import wait_until


def answer(url, body=None):
    """What is answered to a GET, or to a POST of `body`; None while it is refused."""
    with suppress(OSError):
        status, text = fetch(url, body)
        return (text or "empty") if status < 300 else None


@contextmanager
def serving(command, url):
    """A program, once there is an answer at `url`."""
    with TemporaryDirectory() as folder, Program(command, Path(folder) / "log") as process:
        process.wait_for(lambda: answer(url))
        yield
        process.terminate()


@contextmanager
def server(folder, port):
    """InfluxDB at `port` with the database "house": the keys `url`, `user` and `password_file` of a table."""
    settings = Path(__file__).with_name("influxdb.conf").read_text(encoding="utf-8")
    settings = settings.format(own=free_port(), port=port, folder=folder)
    (folder / "influxdb.conf").write_text(settings, encoding="utf-8")
    (folder / "password").write_text("test-only\n")
    table = {"url": f"http://127.0.0.1:{port}", "user": "reader", "password_file": folder / "password"}
    with serving([program("influxd", "influxdb"), "-config", str(folder / "influxdb.conf")], f"{table['url']}/ping"):
        post(table, "/query", {"q": "CREATE USER reader WITH PASSWORD 'test-only' WITH ALL PRIVILEGES"})
        post(table, "/query", {"q": "CREATE DATABASE house"})
        yield table


def victoria(folder, port):
    """VictoriaMetrics at `port`."""
    command = [program("victoria-metrics", "victoria-metrics"), f"-storageDataPath={folder}", "-retentionPeriod=10y"]
    return serving([*command, f"-httpListenAddr=127.0.0.1:{port}"], f"http://127.0.0.1:{port}/ping")


def post(table, path, parameters, body=b""):
    """What the server says; asked again while it refuses: a busy one may not know at once a database it has made."""
    login = {"u": table["user"], "p": "test-only"}
    said = wait_until(lambda: answer(f"{table['url']}{path}?{urllib.parse.urlencode(parameters | login)}", body))
    assert "error" not in said, said
    return said
