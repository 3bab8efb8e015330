"""A real browser: Debian's chromium, driven by playwright. Without either, these tests are skipped with the reason."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from support.browser import browser
from support.building import Building, building
from support.processes import program
from support.waiting import PATIENCE

SCREENS = {
    "desktop": {"viewport": {"width": 1280, "height": 800}},
    "phone": {"viewport": {"width": 390, "height": 800}, "has_touch": True, "is_mobile": True},
}


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """A browser for one module: playwright runs an event loop, beside which other tests could not run theirs."""
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install '.[dev]'")
    program("chromium", "chromium")
    with browser() as launched:
        yield launched


GONE = ("ERR_CONNECTION_REFUSED", "ERR_CONNECTION_RESET", "ERR_INCOMPLETE_CHUNKED_ENCODING", "ERR_EMPTY_RESPONSE")
"""What a browser logs once a test has closed its building under a page that is still open."""


class Watched:
    """A page that was opened, with everything it asked for and complained about."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.requests: list[str] = []
        self.complaints: list[str] = []
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("console", lambda message: message.type == "error" and self.complaints.append(message.text))


Visit = Callable[..., Watched]


Serve = Callable[..., Building]


@pytest.fixture
def serve() -> Iterator[Serve]:
    """Serves a building until the pages that look at it are closed."""
    with ExitStack() as stack:
        yield lambda zones, **options: stack.enter_context(building(zones, **options))


@pytest.fixture
def visit(chromium: Any, serve: Serve) -> Iterator[Visit]:
    """Opens an address in a browser of its own; nothing may be complained about, and nothing asked elsewhere."""
    opened: list[tuple[Any, Watched, str, bool]] = []

    def open_page(
        url: str,
        path: str = "/",
        screen: str = "desktop",
        scheme: str = "light",
        locale: str = "en-GB",
        quiet: bool = True,
        before: Callable[[Any], None] | None = None,
    ) -> Watched:
        context = chromium.new_context(
            **SCREENS[screen], color_scheme=scheme, locale=locale, timezone_id="America/New_York"
        )
        context.set_default_timeout(1000 * PATIENCE)
        watched = Watched(context.new_page())
        if before is not None:
            before(watched.page)
        opened.append((context, watched, url, quiet))
        watched.page.goto(url + path)
        return watched

    yield open_page
    for context, watched, url, quiet in opened:
        context.close()
        foreign = [asked for asked in watched.requests if not asked.startswith((url, "blob:", "data:"))]
        assert not foreign, "nothing leaves the machine"
        if quiet:
            left = [said for said in watched.complaints if not any(gone in said for gone in GONE)]
            assert not left
