"""A real InfluxDB of a test's own."""

import shutil
import subprocess
import time
import urllib.error
import urllib.parse
import urllib.request
from contextlib import contextmanager

import pytest
from support.harness import free_port
from support.waiting import PATIENCE


def answered(process, url):
    """Wait until there is an answer at `url`."""
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            with urllib.request.urlopen(url, timeout=PATIENCE):
                return
        except OSError as error:
            if isinstance(error, urllib.error.HTTPError):
                error.close()
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.1)


@contextmanager
def serving(command, url):
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        answered(process, url)
        yield
    finally:
        process.terminate()
        process.wait(timeout=PATIENCE)


@contextmanager
def server(folder, port):
    """InfluxDB at `port` with the database "house": the keys `url`, `user` and `password_file` of a table."""
    if shutil.which("influxd") is None:
        pytest.skip("InfluxDB is not installed here (Debian: influxdb)")
    (folder / "influxdb.conf").write_text(
        f"""
        reporting-disabled = true
        bind-address = "127.0.0.1:{free_port()}"
        [meta]
        dir = "{folder}/meta"
        [data]
        dir = "{folder}/data"
        wal-dir = "{folder}/wal"
        [monitor]
        store-enabled = false
        [http]
        bind-address = "127.0.0.1:{port}"
        auth-enabled = true
        """
    )
    (folder / "password").write_text("test-only\n")
    table = {"url": f"http://127.0.0.1:{port}", "user": "reader", "password_file": folder / "password"}
    with serving(["influxd", "-config", str(folder / "influxdb.conf")], f"{table['url']}/ping"):
        post(table, "/query", {"q": "CREATE USER reader WITH PASSWORD 'test-only' WITH ALL PRIVILEGES"})
        post(table, "/query", {"q": "CREATE DATABASE house"})
        yield table


def post(table, path, parameters, body=b""):
    """What the server says; asked again while it refuses: a busy one may not know at once a database it has made."""
    login = {"u": table["user"], "p": "test-only"}
    request = urllib.request.Request(f"{table['url']}{path}?{urllib.parse.urlencode(parameters | login)}", body)
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
                said = answer.read().decode()
                assert "error" not in said, said
                return said
        except urllib.error.HTTPError as error:
            error.close()
            assert time.monotonic() < deadline
            time.sleep(0.1)
