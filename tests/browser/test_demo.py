"""What the README promises of `make run`, on the real demo in a real browser."""

from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from support.browser import eventually
from support.living_demo import LivingDemo, demo

ROOM = "document.querySelector('[data-zone=\"{}\"] .cell-{}')"


@pytest.fixture(scope="module")
def living() -> Iterator[LivingDemo]:
    with demo() as found:
        # Where nothing has been compiled yet, the first forecasts take minutes.
        httpx.get(f"{found.url}/zones/room1/forecast", params={"horizon": "24h"}, timeout=600).raise_for_status()
        yield found


def cell(room: str, name: str) -> str:
    return ROOM.format(room, name) + ".textContent"


def test_every_room_is_trusted_or_says_why_not_and_is_forecast_for_a_day(visit: Any, living: LivingDemo) -> None:
    page = visit(living.url).page
    page.wait_for_selector("tr[data-zone]")
    for room in ("room1", "room2", "room3", "room4"):
        eventually(page, f"{cell(room, 'later')}.includes('°C')")
        trust, finding = page.evaluate(cell(room, "trust")), page.evaluate(cell(room, "finding"))
        assert trust == "trusted" or (trust != "learning" and finding), (room, trust)
    fan = httpx.get(f"{living.url}/zones/room1/forecast", params={"horizon": "24h"}).json()
    assert len(fan["fan"]) >= 96
    page = visit(living.url, "/#/zone/room1").page
    eventually(page, "document.querySelectorAll('.plot.fan .scatterlayer .trace').length >= 3")


def test_an_open_window_is_noticed(visit: Any, living: LivingDemo) -> None:
    page = visit(living.url).page
    page.wait_for_selector("tr[data-zone]")
    opened = {"kind": "window", "device": "room4", "value": 150.0, "for": 15}
    assert httpx.post(f"{living.control}/faults", json=opened).status_code == 201
    eventually(page, f"{cell('room4', 'finding')}.includes('an open window, people')")


def test_a_set_point_that_is_turned_up_is_followed_and_nothing_else_is_suspected(
    visit: Any, living: LivingDemo
) -> None:
    page = visit(living.url).page
    page.wait_for_selector("tr[data-zone]")
    assert httpx.put(f"{living.control}/rooms/room2", json={"set_point": 23}).status_code == 200
    eventually(page, f"parseFloat({cell('room2', 'now')}) > 22.4")
    for room in ("room2", "room3"):
        assert "u_heat" not in page.evaluate(cell(room, "finding"))
        assert "drifts" not in page.evaluate(cell(room, "finding"))
