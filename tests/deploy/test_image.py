"""The image that buildah has built without an engine, started as its definition asks: `make image-test`."""

import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.harness import EXAMPLES, ask
from support.processes import Program, free_port
from support.waiting import PATIENCE

IMAGE = "localhost/thermogate"
ENVIRONMENT = os.environ | {"STORAGE_DRIVER": "vfs", "BUILDAH_ISOLATION": "chroot"}
LARGEST = 650e6
"""bytes, without compression, on packages of Debian."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif("IMAGE_TEST" not in os.environ, reason="make image-test builds the image first"),
]


def buildah(*words: str) -> str:
    done = subprocess.run(["buildah", *words], env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture(scope="module")
def root() -> Iterator[Path]:
    container = buildah("from", IMAGE)
    yield Path(buildah("mount", container))
    buildah("rm", container)


@pytest.fixture(scope="module")
def definition() -> dict[str, Any]:
    return json.loads(buildah("inspect", "--type", "image", IMAGE))["Docker"]["config"]


def started(root: Path, definition: dict[str, Any], folder: Path, *command: str) -> list[str]:
    """A command in the image: its user and environment, its root read-only, its volumes and the configuration writable
    or not as compose.yaml has it, the network of the machine, no capability."""
    user, group = definition["User"].split(":")
    words = ["bwrap", "--unshare-user", "--uid", user, "--gid", group, "--cap-drop", "ALL", "--clearenv"]
    for one in definition["Env"]:
        words += ["--setenv", *one.split("=", 1)]
    words += ["--ro-bind", str(root), "/", "--proc", "/proc", "--dev", "/dev", "--tmpfs", "/tmp", "--die-with-parent"]
    for volume in definition["Volumes"]:
        words += ["--bind", str(folder / Path(volume).parent.name), volume]
    return [*words, "--ro-bind", str(folder / "etc"), "/etc/thermogate", *command]


def test_its_size(root: Path) -> None:
    size = sum(path.lstat().st_size for path in root.rglob("*") if not path.is_symlink() and path.is_file())
    print(f"{size / 1e6:.0f} MB")
    assert size < LARGEST


def test_the_daemon_starts_in_it_and_is_healthy(root: Path, definition: dict[str, Any], tmp_path: Path) -> None:
    port = free_port()
    for volume in definition["Volumes"]:
        shutil.copytree(root / volume.lstrip("/"), tmp_path / Path(volume).parent.name)
    shutil.copytree(EXAMPLES / "data", tmp_path / "etc" / "data")
    shutil.copy(EXAMPLES / "generic-csv.toml", tmp_path / "etc" / "thermogate.toml")
    settings = ["--set", f"http.port={port}", "--set", "zenoh.enabled=false"]
    command = started(root, definition, tmp_path, *definition["Entrypoint"], *definition["Cmd"], *settings)
    url, begun = f"http://127.0.0.1:{port}", time.monotonic()
    with Program(command, tmp_path / "log") as daemon:
        daemon.says("serving on")
        daemon.wait_for(lambda: ask(f"{url}/zones")[1]["zones"][0]["samples"])
        print(f"first sample after {time.monotonic() - begun:.0f} s")
        check = definition["Healthcheck"]["Test"]
        assert check[0] == "CMD"
        asked = started(root, definition, tmp_path, *check[1:], "--url", url)
        assert subprocess.run(asked, capture_output=True, text=True, timeout=60, check=False).stdout[:2] == "OK"
        written = started(root, definition, tmp_path, "touch", "/opt/thermogate/written")
        refused = subprocess.run(written, capture_output=True, text=True, timeout=60, check=False)
        assert "Read-only file system" in refused.stderr
        assert "journal" in "".join(path.name for path in (tmp_path / "lib").rglob("*"))
        # bubblewrap does not pass signals on, but ends as what it runs does.
        process = daemon.process
        (child,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        os.kill(int(child), signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
