"""Whether the page's memory stays flat over hours of a real daemon: `make page-stream`.

Starts the living demo, opens the overview and a room with its charts beside each other, lets them stream, and looks at
the memory of both and of the daemon at even intervals. The figures go onto the terminal and into a JSON file; it fails
where memory has grown.
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from evidence import Measured
from screenshots import answers
from support.browser import eventually
from support.harness import free_port

ROOT = Path(__file__).parents[2]

PAGES = {"overview": "/", "room": "/#/zone/room1"}
LOOKS = 20
"""How often memory is looked at."""

GROWTH = 1.25
"""How much more the last third may take than the second: the first is caches, compiled code and charts that fill."""


class Look(NamedTuple):
    """Memory at one moment."""

    seconds: int
    samples: int
    heap_mb: dict[str, float]
    """JavaScript of each page, after collecting garbage."""
    nodes: dict[str, int]
    daemon_mb: float
    """Resident."""


def main() -> int:
    """Stream, print, write the figures; 1 where memory grows."""
    parser = argparse.ArgumentParser(description="Stream a real daemon into a real browser and look at the memory.")
    parser.add_argument("--out", type=Path, default=ROOT / "var" / "page-stream.json", help="file of the figures")
    parser.add_argument("--seconds", type=float, default=3600.0, help="how long")
    parser.add_argument("--pace", type=float, default=600.0, help="multiple of real time")
    arguments = parser.parse_args()
    port, looks = free_port(), []
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "service", "demo", "--live", "--port", str(port), "--directory", folder]
        demo = subprocess.Popen(
            [*command, "--pace", f"{arguments.pace:g}"],
            cwd=ROOT,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            url = f"http://127.0.0.1:{port}"
            answers(url, demo)
            looks = _stream(url, demo.pid, arguments.seconds)
        finally:
            demo.terminate()
            demo.wait()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    figures = {"pace": arguments.pace, "looks": [look._asdict() for look in looks]}
    arguments.out.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    grown = [name for name in PAGES if _grows([look.heap_mb[name] for look in looks])]
    grown += ["daemon"] if _grows([look.daemon_mb for look in looks]) else []
    print(arguments.out)
    print(f"memory grows: {', '.join(grown)}" if grown else "memory is flat")
    return 1 if grown else 0


def _stream(url: str, daemon: int, seconds: float) -> list[Look]:
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("chromium is not installed; apt-get install chromium")
    looks: list[Look] = []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        pages = {name: Measured(browser) for name in PAGES}
        for name, path in PAGES.items():
            pages[name].page.goto(url + path)
        pages["overview"].page.wait_for_selector("tr[data-zone]")
        eventually(pages["room"].page, "document.querySelectorAll('.js-plotly-plot .scatterlayer').length >= 2")
        began = time.monotonic()
        while (passed := time.monotonic() - began) < seconds or len(looks) <= LOOKS:
            if passed >= seconds * len(looks) / LOOKS:
                looks.append(_look(url, round(passed), pages, daemon))
                print(looks[-1], flush=True)
            pages["room"].page.wait_for_timeout(1000)
        browser.close()
    return looks


def _look(url: str, passed: int, pages: dict[str, Measured], daemon: int) -> Look:
    heaps: dict[str, tuple[float, int]] = {name: measured.heap() for name, measured in pages.items()}
    with urllib.request.urlopen(f"{url}/zones", timeout=60) as answer:
        zones: list[dict[str, Any]] = json.load(answer)["zones"]
    return Look(
        passed,
        sum(zone["samples"] for zone in zones),
        {name: round(heap, 2) for name, (heap, _) in heaps.items()},
        {name: nodes for name, (_, nodes) in heaps.items()},
        round(_resident(daemon), 1),
    )


def _resident(pid: int) -> float:
    """MB that the process holds in memory."""
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) * 1024 / 1e6 for line in lines if line.startswith("VmRSS:"))


def _grows(values: Sequence[float]) -> bool:
    third = len(values) // 3
    return statistics.median(values[-third:]) > GROWTH * statistics.median(values[third : 2 * third])


if __name__ == "__main__":
    raise SystemExit(main())
