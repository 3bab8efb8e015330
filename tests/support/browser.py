"""Waiting in a page, and what axe says of it."""

from __future__ import annotations

import time
from typing import Any

from support.waiting import PATIENCE


def eventually(page: Any, condition: str, argument: object = None) -> None:
    """Wait until an expression of the page is true. playwright's own waiting evaluates text inside the page, which the
    content security policy forbids."""
    deadline = time.monotonic() + PATIENCE
    while not page.evaluate(condition, argument):
        assert time.monotonic() < deadline, f"never true: {condition}"
        page.wait_for_timeout(20)


def serious(page: Any) -> list[str]:
    """What axe finds serious or worse."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [
        f"{one['id']}: {node['html']}"
        for one in found
        if one["impact"] in ("serious", "critical")
        for node in one["nodes"]
    ]
