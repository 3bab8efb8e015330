"""The table of all rooms, in a real browser."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from support.browser import eventually, hold_accessible
from support.building import Building, building
from support.fake_zones import FakeZone, doubted, running, waiting

from estimator.diagnosis.finding import Diagnosis, Finding
from service.records.trust import HorizonTrust, Trust
from service.web.page import overview

ROWS = "tr[data-zone]"
GREEN = """[...document.querySelectorAll("body *:not(.plot *, .legend *)")].filter((one) =>
  ["", "::before"].some((part) => ["color", "backgroundColor", "borderLeftColor"].some((how) =>
    getComputedStyle(one, part)[how] === "rgb(35, 105, 63)"
))).map((one) => (one.closest("[data-zone]")?.dataset.zone ?? "") + "." + [...one.classList].at(-1))"""
"""What on the page has the colour of what is good."""
NOW = "document.querySelector('[data-zone=\"room-0\"] .cell-now')"


@pytest.fixture(autouse=True)
def _quick_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(overview, "PAUSE", 0.05)


def stalled(name: str) -> FakeZone:
    zone = running(name, 100)
    zone.state, zone.reason = "stalled", "T_out is 1500 s old, older than hold_inputs = 900 s"
    return zone


def cold_boiler(name: str) -> FakeZone:
    """A zone with something to mend, beside what only experts would look at."""
    zone = doubted(name)
    found = Finding("calls-without-heat", "u_heat", "the set-point called for heat and none came; check the boiler")
    zone.diagnosis = Diagnosis((found, *zone.diagnosis.findings))
    return zone


def comfortable(zone: FakeZone) -> FakeZone:
    """`zone`, as warm as it was meant to be all the time."""
    zone.updates = [update._replace(setpoint=update.y[0]) for update in zone.updates]
    return zone


def many(count: int) -> dict[str, FakeZone]:
    """`count` rooms, of which some have trouble if there are more than one."""
    pattern = comfortable(running("pattern", 100))
    zones = [replace(pattern, id=f"room-{index}", updates=list(pattern.updates), asked=[]) for index in range(count)]
    if count > 3:
        zones[-3:] = [cold_boiler("room-doubted"), waiting("room-waiting"), stalled("room-stalled")]
    return {zone.id: zone for zone in zones}


@pytest.fixture(scope="module")
def thirty() -> Iterator[Building]:
    with building(many(30)) as served:
        yield served


@pytest.fixture(scope="module")
def thousand() -> Iterator[Building]:
    with building(many(1000)) as served:
        yield served


def rooms_of(visit: Any, house: Building, **options: Any) -> Any:
    """The page of the rooms, once they show."""
    page = visit(house.url, **options).page
    page.wait_for_selector(ROWS)
    return page


def names(page: Any) -> list[str]:
    return [str(name) for name in page.eval_on_selector_all(ROWS, "rows => rows.map(row => row.dataset.zone)")]


def test_the_worst_rooms_come_first_with_their_finding_in_words(visit: Any, thirty: Building) -> None:
    page = rooms_of(visit, thirty)
    assert names(page)[:4] == ["room-stalled", "room-waiting", "room-doubted", "room-0"]
    doubt = page.locator('[data-zone="room-doubted"]')
    assert doubt.locator(".cell-finding").inner_text() == "the thermostat calls and nothing comes"
    assert doubt.locator(".cell-now").inner_text() == "19.5 °C"
    # The outlook and the sparkline come by the stream, once they are made.
    eventually(page, "document.querySelector('[data-zone=\"room-0\"] .cell-later').textContent.includes('°C')")
    eventually(page, "document.querySelector('[data-zone=\"room-0\"] .spark-line').getAttribute('d')")
    silent = page.locator('[data-zone="room-stalled"]')
    assert silent.locator(".cell-hour").inner_text() == "–", "nobody vouches for it"
    assert silent.locator("time").get_attribute("title").endswith("UTC")


def test_a_room_that_is_colder_than_its_set_point_comes_before_the_others(serve: Any, visit: Any) -> None:
    zones = many(6)
    for name, above in (("room-1", -3.0), ("room-2", 1.5), ("room-0", 1.5)):
        newest = zones[name].updates[-1]
        zones[name].updates[-1] = newest._replace(setpoint=newest.y[0] + above)
    # The set-point of the last one has just risen: it has yet to warm up.
    *earlier, last = zones["room-2"].updates
    zones["room-2"].updates = [one._replace(setpoint=math.nan) for one in earlier] + [last]
    page = rooms_of(visit, serve(zones))
    eventually(page, "document.querySelectorAll('tr[data-zone]')[3].dataset.zone === 'room-2'")
    assert names(page)[:4] == ["room-stalled", "room-waiting", "room-doubted", "room-2"]
    assert page.locator('[data-zone="room-2"] .cell-finding').inner_text() == "1.5 K colder than its set-point"
    for name in ("room-1", "room-0"):
        page.wait_for_selector(f"[data-zone={name}] .cell-finding >> text=nothing unusual")
    assert "\nset to " in page.locator('[data-zone="room-2"] .cell-now').inner_text()


def test_a_room_that_was_too_cold_comes_before_one_whose_forecast_is_outdone(serve: Any, visit: Any) -> None:
    outdone, cold = running("a-forecast"), running("b-cold", 48)
    outdone.trusted = Trust(0, (HorizonTrust(6 * 3600, "trusted", "", 0),), beaten="6 h ahead, no change is better")
    cold.updates = [update._replace(setpoint=21.0) for update in cold.updates[:-1]] + cold.updates[-1:]
    page = visit(serve({zone.id: zone for zone in (outdone, cold)}).url).page
    page.wait_for_selector("[data-zone=b-cold] .cell-finding >> text=too cold for 4 h of 7 days")
    assert names(page) == ["b-cold", "a-forecast"]
    page.locator("[data-filter=attention]").click()
    assert names(page) == ["b-cold", "a-forecast"]


def test_nothing_is_green_beside_a_doubt(serve: Any, visit: Any) -> None:
    def room(name: str, level: str = "trusted", beaten: str = "", steps: int = 3, **changes: Any) -> FakeZone:
        told = tuple(HorizonTrust(lead, level, "why" * (level != "trusted"), 0) for lead in (3600, 6 * 3600))
        return replace(comfortable(running(name, steps)), trusted=Trust(0, told, beaten=beaten), **changes)

    zones = [room("fine"), room("beaten", beaten="6 h ahead, no change is better"), room("late", reason="20 s behind")]
    zones += [room(level, level) for level in ("learning", "doubtful", "untrusted")]
    zones += [room("disturbed", steps=210), room("failed", "untrusted", state="failed", reason="it broke")]
    zones += [stalled("stalled"), waiting("waiting")]
    house = serve({zone.id: zone for zone in zones})
    page = visit(house.url, quiet=False).page
    eventually(page, f"document.querySelectorAll('{ROWS}').length === {len(zones)}")
    assert page.evaluate(GREEN) == ["fine.trust-trusted"]
    for zone in zones:
        page.goto(f"{house.url}/#/zone/{zone.id}")
        page.wait_for_selector(f"h1 >> text={zone.id}")
        eventually(page, "document.querySelector('.doubt').textContent !== ''")
        assert page.evaluate(GREEN) == ([".fine"] if zone.id == "fine" else []), zone.id


def test_what_only_experts_mend_calls_for_nobody_and_a_forecast_that_is_outdone_is_not_green(
    serve: Any, visit: Any
) -> None:
    expert, outdone = comfortable(doubted("expert")), comfortable(running("outdone"))
    better = (
        "1 h ahead, no change is the better forecast: off by 0.2 K, the model by 0.3 K; rely on the model 6 h ahead"
    )
    trusted = (HorizonTrust(6 * 3600, "trusted", "", 0),)
    outdone.trusted = Trust(0, trusted, beaten=better, good_up_to=900)
    further = comfortable(running("further"))
    further.trusted = Trust(0, trusted, beaten="24 h ahead, no change is the better forecast", good_up_to=6 * 3600)
    page = rooms_of(visit, serve({zone.id: zone for zone in (expert, outdone, further)}))
    assert page.locator('[data-zone="expert"] .cell-finding').inner_text() == "nothing unusual"
    assert page.locator('[data-zone="outdone"] .cell-finding').inner_text() == "in part, a simpler forecast is better"
    trust = page.locator('[data-zone="outdone"] .cell-trust')
    assert trust.text_content() == "in part: " + (trust.get_attribute("title") or "nothing")
    assert page.locator('[data-zone="further"] .cell-trust').inner_text().startswith("up to 6 h")
    page.locator("[data-filter=attention]").click()
    eventually(page, "document.querySelectorAll('tr[data-zone]').length === 2")
    assert names(page) == ["further", "outdone"]


def test_sort_filter_and_search(visit: Any, thirty: Building) -> None:
    page = rooms_of(visit, thirty)
    page.locator("th.cell-room button").click()
    eventually(page, "document.querySelector('tr[data-zone]').dataset.zone === 'room-0'")
    # As people count: 2 before 10.
    assert names(page)[:3] == ["room-0", "room-1", "room-2"]
    page.locator("th.cell-room button").click()
    eventually(page, "document.querySelector('tr[data-zone]').dataset.zone === 'room-waiting'")
    assert page.locator("th.cell-room").get_attribute("aria-sort") == "descending"
    page.locator("[data-filter=attention]").click()
    eventually(page, "document.querySelectorAll('tr[data-zone]').length === 3")
    page.locator("#search").fill("thermostat")
    eventually(page, "document.querySelectorAll('tr[data-zone]').length === 1")
    assert names(page) == ["room-doubted"]
    page.locator("#search").fill("nowhere")
    page.wait_for_selector("text=No room matches.")


@pytest.mark.parametrize("screen", ["desktop", "phone"])
def test_axe_finds_nothing(visit: Any, thirty: Building, screen: str) -> None:
    page = rooms_of(visit, thirty, screen=screen)
    hold_accessible(page)


@pytest.mark.parametrize("screen", ["desktop", "phone"])
def test_only_the_rows_in_view_are_drawn_but_all_are_printed(visit: Any, thousand: Building, screen: str) -> None:
    watched = visit(thousand.url, screen=screen)
    page = watched.page
    page.wait_for_selector(ROWS)
    assert len(names(page)) <= 40
    page.evaluate("window.scrollTo(0, document.documentElement.scrollHeight)")
    page.wait_for_selector('[data-zone="room-996"]')
    assert len(names(page)) <= 40
    assert page.locator("table").get_attribute("aria-rowcount") == "1001"
    asked = [url.removeprefix(thousand.url) for url in watched.requests]
    assert (asked.count("/overview"), asked.count("/overview/stream")) == (1, 1), "one request and one stream"
    assert not [url for url in asked if url.startswith("/zones") or "plotly" in url]
    sizes = "performance.getEntriesByType('resource').map(({encodedBodySize}) => encodedBodySize)"
    assert 10_000 < sum(page.evaluate(sizes)) < 150_000, "bytes over the wire"
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert len(names(page)) == 1000
    assert not page.locator(".tools").is_visible()
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert len(names(page)) < 60


def test_news_comes_by_the_stream_and_moves_the_room_up(serve: Any, visit: Any) -> None:
    served = serve(many(30))
    page = rooms_of(visit, served)
    served.step("room-7", state="failed", reason="the estimator diverged")
    eventually(page, "document.querySelector('tr[data-zone]').dataset.zone === 'room-7'")
    assert page.locator('[data-zone="room-7"] .cell-finding').inner_text() == "the estimator diverged"
    served.remove("room-7")
    eventually(page, "document.querySelector('tr[data-zone]').dataset.zone === 'room-stalled'")
    assert "room-7" not in names(page)


def test_a_broken_connection_is_told_and_mended(serve: Any, visit: Any) -> None:
    served = serve(many(3))
    page = visit(served.url, quiet=False).page
    page.wait_for_selector(".live")
    served.offline()
    page.wait_for_selector("text=no connection to the daemon")
    assert len(names(page)) == 3, "what was known stays"
    served.zones["room-1"].state = "failed"
    served.open()
    page.wait_for_selector(".live")
    eventually(page, "document.querySelector('tr[data-zone]').dataset.zone === 'room-1'")
    # A room that is chosen without a connection shows once there is one.
    served.offline()
    page.locator('[data-zone="room-1"] a').click()
    page.wait_for_selector("text=no connection to the daemon")
    served.open()
    page.wait_for_selector("h1:has-text('room-1')")


def test_an_answer_that_fails_once_is_asked_for_again(serve: Any, visit: Any) -> None:
    def failing(page: Any) -> None:
        page.route("**/overview", lambda route: route.fulfill(status=503, body="busy"), times=1)

    served = serve(many(3))
    page = visit(served.url, quiet=False, before=failing).page
    page.wait_for_selector("text=no connection to the daemon")
    page.wait_for_selector(ROWS)
    page.wait_for_selector(".live")
    served.step("room-1", state="failed", reason="the estimator diverged")
    page.wait_for_selector("text=the estimator diverged")


def test_a_stream_is_resumed_after_sleep_and_not_because_the_page_was_busy(serve: Any, visit: Any) -> None:
    served = serve(many(3))
    watched = visit(served.url, before=lambda page: page.clock.install())
    page = watched.page
    page.wait_for_selector(".live")

    def streams() -> int:
        return [url.removeprefix(served.url) for url in watched.requests].count("/overview/stream")

    # The daemon sends something every 15 s; a page that could not look for 46 s finds it when it looks again.
    page.clock.fast_forward(46_000)
    served.step("room-0", state="failed", reason="the estimator diverged")
    page.wait_for_selector("text=the estimator diverged")
    assert streams() == 1
    # A connection that is silent whenever it is looked at is dead.
    while streams() == 1:
        page.clock.fast_forward(46_000)
        page.wait_for_timeout(20)
    page.wait_for_selector(".live")
    served.step("room-0", reason="the estimator diverged again")
    page.wait_for_selector("text=the estimator diverged again")


def test_an_hour_of_a_thousand_rooms_leaves_memory_flat(visit: Any, thousand: Building) -> None:
    """Twelve samples of every room: what an hour brings, as fast as it can be sent."""
    page = rooms_of(visit, thousand)
    session = page.context.new_cdp_session(page)

    def minutes(samples: int) -> tuple[float, int]:
        for _ in range(samples):
            thousand.step(*(name for name, zone in thousand.zones.items() if zone.updates))
            shown = thousand.zones["room-0"].updates[-1].y[0]
            eventually(page, f"text => {NOW}?.textContent === text", f"{shown:.1f} °C")
        session.send("HeapProfiler.collectGarbage")
        counters = session.send("Memory.getDOMCounters")
        return page.evaluate("performance.memory.usedJSHeapSize"), counters["nodes"]

    before, nodes = minutes(3)
    after, nodes_after = minutes(12)
    assert after < before + 3e6, "a leak of one row per event would be tens of MB"
    assert nodes_after < nodes + 500


def test_german_and_english_and_a_choice_that_stays(visit: Any, thirty: Building) -> None:
    page = rooms_of(visit, thirty, locale="de-DE")
    page.wait_for_selector("h1:has-text('Räume')")
    assert page.locator('[data-zone="room-doubted"] .cell-now').inner_text() == "19,5 °C"
    assert page.evaluate("document.documentElement.lang") == "de"
    page.locator("#language").select_option("en")
    page.wait_for_selector("h1:has-text('Rooms')")
    page.reload()
    page.wait_for_selector("h1:has-text('Rooms')")


def test_the_table_is_worked_by_keyboard(visit: Any, thirty: Building) -> None:
    page = rooms_of(visit, thirty)
    page.locator('[data-zone="room-stalled"] a').focus()
    for _ in range(25):
        page.keyboard.press("Tab")
        # Nobody is faster than the next two frames, in which the rows that follow are drawn.
        page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    focused = page.evaluate("document.activeElement.closest('tr').dataset.zone")
    assert focused == "room-22", "row after row, also into what was not in view"
    page.keyboard.press("Enter")
    page.wait_for_selector("h1:has-text('room-22')")
