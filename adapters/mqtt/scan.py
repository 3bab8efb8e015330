"""What is published on a broker, and which numbers are in it: for the person who has no list of topics."""

from __future__ import annotations

from collections.abc import Mapping

from adapters.messages.inbox import Incoming
from adapters.payload.payload import numbers_in
from adapters.scanning import Scanned

HEADINGS = ("topic", "pointer", "number", "came")

MOST_TOPICS = 2000
"""Topics that are kept of all that a broker has."""

_SHOWN = 5


def published_here(topic: str) -> bool:
    """Whether Thermogate publishes on `topic` itself: results of zones, and what Home Assistant discovers them by."""
    first, *rest = topic.split("/")
    return first == "thermogate" or (topic.endswith("/config") and any(part.startswith("thermogate_") for part in rest))


def scanned(heard: Mapping[str, Incoming], seconds: float) -> Scanned:
    """The numbers in the newest message of every topic that was `heard` within `seconds`, one a row. A number that is
    the whole payload has no pointer."""
    rows: list[tuple[str, ...]] = [HEADINGS]
    wordless: list[str] = []
    for topic in sorted(heard):
        incoming = heard[topic]
        numbers = numbers_in(incoming.payload or b"")
        came = "retained" if incoming.retained else "live"
        rows += [(topic, pointer or "-", f"{number:g}", came) for pointer, number in numbers]
        if not numbers:
            wordless.append(topic)
    remarks = [] if heard else [f"nothing came within {seconds:g} s, and nothing was retained; listen for longer"]
    if wordless:
        more = ", ..." if len(wordless) > _SHOWN else ""
        remarks.append(f"topics without a number: {len(wordless)} ({', '.join(wordless[:_SHOWN])}{more})")
    if len(heard) >= MOST_TOPICS:
        remarks.append(f"more than {MOST_TOPICS} topics are published; the rest is not listed")
    return Scanned(rows, remarks)
