"""What the page weighs and how quick it is: `make page`, a minute.

Invented zones behind the real HTTP server, and Debian's chromium with its processor throttled. The figures go into a
JSON file and onto the terminal; docs/page.md has those of one machine.
"""

from __future__ import annotations

import statistics
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from integration.command import command
from support.browser import browser, eventually
from support.building import Building, building
from support.fake_zones import FakeZone, running

THROTTLE = 6
REPEATS = 5


def rooms(count: int) -> dict[str, FakeZone]:
    """`count` rooms with a day of samples each."""
    pattern = running("pattern", 288)
    return {
        name: replace(pattern, id=name, updates=list(pattern.updates), asked=[])
        for name in (f"room-{index}" for index in range(count))
    }


class Measured:
    """A page with an instrument for its network and memory."""

    def __init__(self, browser: Any, throttle: int = 1) -> None:
        self.context = browser.new_context(viewport={"width": 1280, "height": 800})
        self.context.set_default_timeout(180_000)
        self.page = self.context.new_page()
        self.session = self.context.new_cdp_session(self.page)
        self.session.send("Network.enable")
        self.session.send("Emulation.setCPUThrottlingRate", {"rate": throttle})
        self.bytes: dict[str, int] = {}
        self._urls: dict[str, str] = {}
        self.session.on("Network.requestWillBeSent", lambda e: self._urls.update({e["requestId"]: e["request"]["url"]}))
        self.session.on("Network.dataReceived", self._received)

    def _received(self, event: dict[str, Any]) -> None:
        url = self._urls.get(event["requestId"], "")
        self.bytes[url] = self.bytes.get(url, 0) + event["encodedDataLength"]

    def weight(self, *without: str) -> int:
        """Bytes of bodies over the wire, of addresses that contain none of `without`."""
        return sum(size for url, size in self.bytes.items() if not any(word in url for word in without))

    def heap(self) -> tuple[float, int]:
        """MB of JavaScript, and nodes of the page, after collecting garbage."""
        self.session.send("HeapProfiler.collectGarbage")
        used = self.session.send("Runtime.getHeapUsage")["usedSize"]
        return used / 1e6, self.session.send("Memory.getDOMCounters")["nodes"]


def paint(browser: Any, served: Building) -> dict[str, float]:
    """Medians over fresh browsers, throttled: ms to the first paint, to the first rows; kB over the wire."""
    first, filled, weights, whole = [], [], [], []
    for _ in range(REPEATS):
        measured = Measured(browser, THROTTLE)
        page = measured.page
        page.goto(served.url)
        page.wait_for_selector("tr[data-zone]")
        filled.append(page.evaluate("performance.now()"))
        first.append(page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime"))
        page.wait_for_timeout(500)
        weights.append(measured.weight("/overview"))
        whole.append(measured.weight("/stream"))
        measured.context.close()
    return {
        "first_paint_ms": round(statistics.median(first)),
        "rows_ms": round(statistics.median(filled)),
        "page_kB": round(statistics.median(weights) / 1000, 1),
        "with_data_kB": round(statistics.median(whole) / 1000, 1),
    }


def scrolling(browser: Any, served: Building) -> dict[str, float]:
    """Frame times while a thousand rows are scrolled through, throttled, ms."""
    measured = Measured(browser, THROTTLE)
    page = measured.page
    page.goto(served.url)
    page.wait_for_selector("tr[data-zone]")
    frames = page.evaluate(
        """() => new Promise((resolve) => {
          const times = [];
          let last = performance.now();
          const step = (now) => {
            times.push(now - last);
            last = now;
            window.scrollBy(0, 400);
            if (times.length < 100) requestAnimationFrame(step);
            else resolve(times.slice(1));
          };
          requestAnimationFrame(step);
        })"""
    )
    measured.context.close()
    ordered = sorted(frames)
    return {"median_ms": round(ordered[len(ordered) // 2], 1), "p95_ms": round(ordered[int(0.95 * len(ordered))], 1)}


def room(browser: Any, served: Building) -> dict[str, float]:
    """The view of a room: ms to its charts, first and second time; kB of plotly.js and of all else."""
    measured = Measured(browser)
    page = measured.page
    found: dict[str, float] = {}
    for name, path in (("first_ms", "/#/zone/room-0"), ("second_ms", "/#/zone/room-1")):
        began = time.monotonic()
        page.goto(served.url + path)
        eventually(page, f"document.querySelector('h1')?.textContent === '{path.rpartition('/')[2]}'")
        eventually(page, "document.querySelectorAll('.js-plotly-plot .scatterlayer').length >= 2")
        found[name] = round(1000 * (time.monotonic() - began))
    found["plotly_kB"] = round(sum(size for url, size in measured.bytes.items() if "plotly" in url) / 1000, 1)
    found["else_kB"] = round(measured.weight("plotly", "/stream") / 1000, 1)
    measured.context.close()
    return found


@dataclass
class Figures:
    """What was measured."""

    overview: dict[int, dict[str, float]]
    """By the number of rooms."""
    scrolling: dict[str, float]
    room: dict[str, float]
    good: bool = True

    def lines(self) -> list[str]:
        """For a person."""
        overviews = [f"overview of {count}: {found}" for count, found in self.overview.items()]
        return [*overviews, f"scrolling: {self.scrolling}", f"room: {self.room}"]


def measure() -> Figures:
    """Measure everything."""
    found = Figures({}, {}, {})
    with browser() as launched:
        for count in (1, 30, 1000):
            with building(rooms(count)) as served:
                found.overview[count] = paint(launched, served)
                if count == 30:
                    found.room = room(launched, served)
                if count == 1000:
                    found.scrolling = scrolling(launched, served)
    return found


if __name__ == "__main__":
    sys.exit(command("measure the page with a real browser", measure))
