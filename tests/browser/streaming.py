"""Whether the page's memory stays flat over hours of a real daemon: `make page-stream`.

Starts the living demo, opens the overview and a room with its charts beside each other, lets them stream, and looks at
the memory of both and of the daemon at even intervals. The figures go onto the terminal and into a JSON file; it fails
where memory has grown.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
import urllib.request
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from evidence import Measured
from screenshots import demo
from support.browser import browser, eventually

ROOT = Path(__file__).parents[2]

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


class Look(NamedTuple):
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


def main() -> int:
    """Stream, print, write the figures; 1 where memory grows."""
    parser = argparse.ArgumentParser(description="Stream a real daemon into a real browser and look at the memory.")
    parser.add_argument("--out", type=Path, default=ROOT / "var" / "page-stream.json", help="file of the figures")
    parser.add_argument("--seconds", type=float, default=3600.0, help="how long")
    parser.add_argument("--pace", type=float, default=600.0, help="multiple of real time")
    arguments = parser.parse_args()
    with demo("--pace", f"{arguments.pace:g}") as (url, process):
        looks = _stream(url, process, arguments.seconds)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    figures = {"pace": arguments.pace, "looks": [look._asdict() for look in looks]}
    arguments.out.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    print(arguments.out)
    return _judged(looks)


def _stream(url: str, daemon: int, seconds: float) -> list[Look]:
    looks: list[Look] = []
    with browser() as launched:
        pages = {name: Measured(launched) for name in PAGES}
        for name, path in PAGES.items():
            pages[name].page.goto(url + path)
        pages["overview"].page.wait_for_selector("tr[data-zone]")
        eventually(pages["room"].page, "document.querySelectorAll('.js-plotly-plot .scatterlayer').length >= 2")
        began = time.monotonic()
        while (passed := time.monotonic() - began) < seconds or len(looks) <= LOOKS:
            if passed >= seconds * len(looks) / LOOKS:
                thorough = len(looks) in (round(SETTLED * LOOKS), LOOKS)
                looks.append(_look(url, round(passed), pages, daemon, thorough))
                print(looks[-1], flush=True)
            pages["room"].page.wait_for_timeout(1000)
    return looks


def _look(url: str, passed: int, pages: dict[str, Measured], daemon: int, thorough: bool) -> Look:
    heaps: dict[str, tuple[float, int]] = {name: measured.heap() for name, measured in pages.items()}
    with urllib.request.urlopen(f"{url}/zones", timeout=60) as answer:
        zones: list[dict[str, Any]] = json.load(answer)["zones"]
    return Look(
        passed,
        sum(zone["samples"] for zone in zones),
        {name: round(heap, 2) for name, (heap, _) in heaps.items()},
        {name: nodes for name, (_, nodes) in heaps.items()},
        round(_resident(daemon), 1),
        {name: round(_held(measured.session), 2) for name, measured in pages.items()} if thorough else {},
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


def _resident(pid: int) -> float:
    """MB that the process holds in memory."""
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) * 1024 / 1e6 for line in lines if line.startswith("VmRSS:"))


def _judged(looks: Sequence[Look]) -> int:
    """Print how fast everything grew once it had settled; 1 where that is too fast."""
    first, last = (look for look in looks if look.held_mb)
    hours = (last.seconds - first.seconds) / 3600
    settled = [look for look in looks if look.seconds >= first.seconds]
    times = [look.seconds / 3600 for look in settled]
    daemon = statistics.linear_regression(times, [look.daemon_mb for look in settled])
    rates = {name: (last.held_mb[name] - first.held_mb[name]) / hours for name in PAGES} | {"daemon": daemon.slope}
    for name, rate in rates.items():
        print(f"{name}: {rate:+.2f} MB an hour, {FLAT[name]:.2f} at most")
    if last.seconds < SHORTEST:
        print(f"less than {SHORTEST} s tell nothing")
        return 0
    grown = [name for name, rate in rates.items() if rate > FLAT[name]]
    print(f"memory grows: {', '.join(grown)}" if grown else "memory is flat")
    return 1 if grown else 0


if __name__ == "__main__":
    raise SystemExit(main())
