"""The demo as a visitor starts it."""

import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from support.harness import ROOT
from support.processes import Program


class LivingDemo(NamedTuple):
    """Where it is asked."""

    url: str
    """Of the page."""
    control: str
    """Of the building's control surface."""


@contextmanager
def demo() -> Iterator[LivingDemo]:
    """The living demo, once it serves its page."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "service", "demo", "--port", "0", "--directory", folder]
        # Zenoh's port belongs to whatever else runs here.
        command += ["--set", "zenoh.enabled=false"]
        with Program(command, Path(folder) / "log", cwd=ROOT) as running:
            url = running.says(r"serving on (\S+)", 600)[1]
            yield LivingDemo(url, running.says(r"curl (\S+)/faults")[1])
            running.terminate()
