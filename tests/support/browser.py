"""A real browser, waiting in a page, and what axe says of it."""

import json
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from support.waiting import PATIENCE


@contextmanager
def browser() -> Iterator[Any]:
    """Debian's chromium, driven by playwright; SystemExit where there is none."""
    from playwright.sync_api import sync_playwright

    executable = shutil.which("chromium")
    if executable is None:
        raise SystemExit("chromium is not installed; apt-get install chromium")
    with sync_playwright() as driver:
        # As root, as in a container of CI, chromium has no sandbox of its own.
        launched = driver.chromium.launch(executable_path=executable, args=["--no-sandbox", "--disable-gpu"])
        yield launched
        launched.close()


def eventually(page: Any, condition: str, argument: object = None) -> None:
    """Wait until an expression of the page is true. playwright's own waiting evaluates text inside the page, which the
    content security policy forbids."""
    deadline = time.monotonic() + PATIENCE
    while not page.evaluate(condition, argument):
        assert time.monotonic() < deadline, f"never true: {condition}; the page says {page.inner_text('body')}"
        page.wait_for_timeout(20)


def drag(page: Any, selector: str, begin: tuple[float, float], end: tuple[float, float]) -> None:
    """Move the pressed mouse from one place of an element to another; places are shares of its width and height."""
    area, deadline = page.locator(selector), time.monotonic() + PATIENCE
    # What comes late moves what is below it, and a press beside the element does nothing.
    while not area.evaluate("node => node.matches(':active')"):
        assert time.monotonic() < deadline, f"never pressed: {selector}"
        page.mouse.up()
        size = area.bounding_box()
        area.hover(position={"x": begin[0] * size["width"], "y": begin[1] * size["height"]})
        page.mouse.down()
    box = area.bounding_box()
    page.mouse.move(box["x"] + end[0] * box["width"], box["y"] + end[1] * box["height"], steps=20)
    page.mouse.up()


def axe_finds(page: Any) -> list[str]:
    """What axe finds, the least of it included."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [f"{one['id']}: {node['html']}" for one in found for node in one["nodes"]]


def hold_accessible(page: Any) -> None:
    """Axe finds nothing in light and dark, and there is nothing to scroll sideways."""
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        assert axe_finds(page) == [], scheme
    width = page.evaluate("[document.documentElement.scrollWidth, window.innerWidth]")
    assert width[0] <= width[1], "nothing to scroll sideways"


HELD = {"object", "array", "string", "concatenated string", "sliced string", "number", "closure", "regexp"}
"""What a page holds, in the words of a heap snapshot. The rest is the engine's own, above all the code that it goes on
compiling for hours."""


def held(session: Any) -> int:
    """Bytes that the page of a CDP session holds, after collecting garbage; takes seconds."""
    chunks: list[str] = []

    def take(event: dict[str, str]) -> None:
        chunks.append(event["chunk"])

    session.send("HeapProfiler.collectGarbage")
    session.on("HeapProfiler.addHeapSnapshotChunk", take)
    session.send("HeapProfiler.takeHeapSnapshot", {"reportProgress": False})
    session.remove_listener("HeapProfiler.addHeapSnapshotChunk", take)
    snapshot = json.loads("".join(chunks))
    fields, (kinds, *_) = snapshot["snapshot"]["meta"]["node_fields"], snapshot["snapshot"]["meta"]["node_types"]
    nodes, width = snapshot["nodes"], len(fields)
    types, sizes = nodes[fields.index("type") :: width], nodes[fields.index("self_size") :: width]
    return sum(size for kind, size in zip(types, sizes, strict=True) if kinds[kind] in HELD)
