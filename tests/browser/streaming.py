"""Whether the page's memory stays flat over hours of a real daemon: `make page-stream`.

Starts the living demo, opens the overview and a room with its charts beside each other, lets them stream, and looks at
the memory of both and of the daemon at even intervals. The figures go onto the terminal and into a JSON file; it fails
where memory has grown.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from browser.screenshots import demo
from integration.command import command
from support.browser import browser, eventually
from support.harness import ask
from support.observed import resident_bytes

PAGES = {"overview": "/", "room": "/#/zone/room1"}
LOOKS = 20
"""How often memory is looked at."""

SETTLED = 0.5
"""The part of the time that is left out: caches and charts fill, which ends."""

FLAT = {"overview": 1.0, "room": 1.0, "daemon": 8.0}
"""MB that each may grow in an hour once it has settled. In an hour a chart is drawn up to 720 times, so that a page may
keep 1.4 kB each time: less than 0.5 MB a day with a sample every 5 min. An hour at 600 times real time is 25 days for
the daemon, whose 8 MB are less than 2 % of what it takes."""

SHORTEST = 1800
"""s; in less, the ten minutes that a chart shows and the daemon's caches are still filling, and nothing is judged."""

HELD = {"object", "array", "string", "concatenated string", "sliced string", "number", "closure", "regexp"}
"""What a page holds, in the words of a heap snapshot. The rest is the engine's own, above all the code that it goes on
compiling for hours."""


@dataclass(frozen=True)
class Look:
    """Memory at one moment."""

    seconds: int
    samples: int
    heap_mb: dict[str, float]
    """JavaScript of each page with what the engine has compiled, after collecting garbage."""
    nodes: dict[str, int]
    daemon_mb: float
    """Resident."""
    held_mb: dict[str, float]
    """What each page holds; at the end of the settling and at the end only, for it takes seconds."""


def _stream(url: str, daemon: int, seconds: float) -> list[Look]:
    looks: list[Look] = []
    with browser() as launched:
        pages = {name: launched.new_context(viewport={"width": 1280, "height": 800}).new_page() for name in PAGES}
        sessions = {name: page.context.new_cdp_session(page) for name, page in pages.items()}
        for name, path in PAGES.items():
            pages[name].goto(url + path)
        pages["overview"].wait_for_selector("tr[data-zone]")
        eventually(pages["room"], "document.querySelectorAll('.js-plotly-plot .scatterlayer').length >= 2")
        began = time.monotonic()
        while (passed := time.monotonic() - began) < seconds or len(looks) <= LOOKS:
            if passed >= seconds * len(looks) / LOOKS:
                thorough = len(looks) in (round(SETTLED * LOOKS), LOOKS)
                looks.append(_look(url, round(passed), sessions, daemon, thorough))
                print(looks[-1], flush=True)
            pages["room"].wait_for_timeout(1000)
    return looks


def _look(url: str, passed: int, sessions: dict[str, Any], daemon: int, thorough: bool) -> Look:
    for session in sessions.values():
        session.send("HeapProfiler.collectGarbage")
    samples = sum(zone["samples"] for zone in ask(f"{url}/zones")[1]["zones"])
    return Look(
        passed,
        samples,
        {name: round(one.send("Runtime.getHeapUsage")["usedSize"] / 1e6, 2) for name, one in sessions.items()},
        {name: one.send("Memory.getDOMCounters")["nodes"] for name, one in sessions.items()},
        round(resident_bytes(daemon) / 1e6, 1),
        {name: round(_held(one), 2) for name, one in sessions.items()} if thorough else {},
    )


def _held(session: Any) -> float:
    """MB of what the page holds, after collecting garbage."""
    chunks: list[str] = []

    def take(event: dict[str, str]) -> None:
        chunks.append(event["chunk"])

    session.on("HeapProfiler.addHeapSnapshotChunk", take)
    session.send("HeapProfiler.takeHeapSnapshot", {"reportProgress": False})
    session.remove_listener("HeapProfiler.addHeapSnapshotChunk", take)
    snapshot = json.loads("".join(chunks))
    fields, (kinds, *_) = snapshot["snapshot"]["meta"]["node_fields"], snapshot["snapshot"]["meta"]["node_types"]
    nodes, width = snapshot["nodes"], len(fields)
    types, sizes = nodes[fields.index("type") :: width], nodes[fields.index("self_size") :: width]
    return sum(size for kind, size in zip(types, sizes, strict=True) if kinds[kind] in HELD) / 1e6


@dataclass
class Streamed:
    """What was seen."""

    pace: float
    looks: list[Look]

    def _rates(self) -> dict[str, float]:
        """MB an hour by which everything grew once it had settled."""
        first, last = (look for look in self.looks if look.held_mb)
        hours = (last.seconds - first.seconds) / 3600
        settled = [look for look in self.looks if look.seconds >= first.seconds]
        times = [look.seconds / 3600 for look in settled]
        daemon = statistics.linear_regression(times, [look.daemon_mb for look in settled])
        return {name: (last.held_mb[name] - first.held_mb[name]) / hours for name in PAGES} | {"daemon": daemon.slope}

    @property
    def good(self) -> bool:
        """Whether nothing grows too fast; little time tells nothing."""
        return self.looks[-1].seconds < SHORTEST or all(rate <= FLAT[name] for name, rate in self._rates().items())

    def lines(self) -> list[str]:
        """For a person."""
        rates = [f"{name}: {rate:+.2f} MB an hour, {FLAT[name]:.2f} at most" for name, rate in self._rates().items()]
        return [*rates, f"less than {SHORTEST} s tell nothing"] if self.looks[-1].seconds < SHORTEST else rates


def measure(seconds: float, pace: float) -> Streamed:
    """Stream for so long at a multiple of real time."""
    with demo("--pace", f"{pace:g}") as (url, process):
        return Streamed(pace, _stream(url, process, seconds))


if __name__ == "__main__":
    sys.exit(
        command("stream a real daemon into a real browser and look at the memory", measure, seconds=3600.0, pace=600.0)
    )
