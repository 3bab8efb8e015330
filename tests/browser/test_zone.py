"""The view of one room, in a real browser."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import pytest
from support.browser import axe_finds, drag, eventually, held, hold_accessible
from support.building import Building, building
from support.fake_zones import START, FakeZone, doubted, foreseen, make_update, running, waiting

from adapters.reading import Quality
from estimator.diagnosis.finding import Diagnosis, Finding
from estimator.network.network import Conductance, HeatInput, Network, Parameter
from service.forecast.answers import Comparison, Demand, LearnedLaw, PlanOutcome, Range
from service.forecast.heating import Called, CompareQuestion, DemandQuestion
from service.records.outlook import InputOrigin, Surroundings
from service.records.trust import HorizonTrust, Trust
from service.records.update import Disturbance

PLOTTED = "document.querySelectorAll('.js-plotly-plot .scatterlayer').length"
HOSTILE = '<img src=x onerror="window.hacked=true">%{y}&amp;\''


def with_gap() -> FakeZone:
    """A day of samples, four hours of which are missing."""
    zone = running("gap", 288)
    zone.updates = [update for index, update in enumerate(zone.updates) if index not in range(100, 148)]
    return zone


@pytest.fixture(scope="module")
def house() -> Iterator[Building]:
    zones = [running("living", 300), doubted("cellar"), with_gap(), waiting("attic")]
    with building({zone.id: zone for zone in zones}) as served:
        yield served


@pytest.fixture
def zone() -> FakeZone:
    return running("living", 300)


def opened(visit: Any, house: Building, zone: str = "living", **options: Any) -> Any:
    watched = visit(house.url, f"/#/zone/{zone}", **options)
    eventually(watched.page, f"{PLOTTED} >= 2")
    return watched


@pytest.mark.parametrize("screen", ["desktop", "phone"])
def test_axe_finds_nothing(visit: Any, house: Building, screen: str) -> None:
    page = opened(visit, house, "cellar", screen=screen).page
    page.locator(".expert summary").click()
    page.locator("section details summary").click()
    hold_accessible(page)


def test_a_room_opens_with_answers_and_what_to_do(visit: Any, house: Building) -> None:
    page = opened(visit, house, "cellar").page
    page.wait_for_selector("text=It loses 113 W for each K that it is warmer than outside")
    assert page.locator(".sentences strong").first.inner_text() == "Heat loss", "what a reader looks for"
    assert page.locator(".answers ol li").inner_text() == (
        "Shade the windows or air – it was too warm for 3 h without much heating"
    )
    assert page.locator(".profile rect").count() == 48
    page.get_by_label("Warm by").fill("07:00")
    page.get_by_role("button", name="When to start?").click()
    reached = "then it has 21.0 °C, or at most 0.5 K less, by Sat, May 3, 07:00 with a probability of 93%."
    page.wait_for_selector(f"text=1.5 h before: {reached}")
    page.locator("section details summary").click()
    page.wait_for_selector(".findings li >> text=C_air is at its bound. C_air is at its lower bound; move it")
    assert page.locator(".expert dl").is_hidden(), "alpha, gate and N_eff are for experts"
    assert page.locator("time").first.get_attribute("title") == "2025-05-03 00:10 UTC"
    # 00:10 UTC in Berlin, wherever the browser is.
    assert "02:10" in page.locator("time").first.inner_text()


def test_without_a_time_zone_of_the_site_a_room_is_warm_by_the_clocks_of_the_browser(serve: Any, visit: Any) -> None:
    page = opened(visit, serve({"living": running("living", 300)}, time_zone=None)).page
    page.get_by_role("button", name="When to start?").click()
    page.wait_for_selector("text=by Sun, May 4, 06:30 with a probability of 93%")


def test_when_to_start_heating_is_told_unasked(serve: Any, visit: Any, zone: FakeZone) -> None:
    zone.heating = foreseen(zone)
    house = serve({"living": zone})
    # What a stalled room cannot answer is complained about.
    page = opened(visit, house, quiet=False).page
    page.wait_for_selector(
        "text=then it has 21.0 °C, or at most 0.5 K less, by Sun, May 4, 05:30 with a probability of 93%."
    )
    assert page.get_by_label("Warm by").input_value() == "05:30", "the form begins with what the answer is about"
    page.locator("#language").select_option("de")
    told = page.locator("text=1,5 h vorher: dann hat er mit einer Wahrscheinlichkeit von 93 %")
    told.wait_for()
    house.step("living", state="stalled", reason="T_out is 1500 s old")
    told.wait_for(state="detached")


def test_a_start_that_is_too_late_says_what_remains(serve: Any, visit: Any, zone: FakeZone) -> None:
    zone.heating = foreseen(zone, start=None, reached=0.65)
    page = opened(visit, serve({"living": zone})).page
    page.wait_for_selector("text=Even if heating starts now")
    page.wait_for_selector("text=only with a probability of 65%")


def test_a_room_is_headed_by_its_temperature_and_set_point(serve: Any, visit: Any, zone: FakeZone) -> None:
    last = zone.updates[-1]._replace(y=(20.44,), setpoint=21.5)
    inputs = tuple(replace(one, value=0.2241) for one in last.forecast.inputs)
    zone.updates[-1] = last._replace(forecast=last.forecast._replace(inputs=inputs))
    house = serve({"living": zone})
    page = opened(visit, house).page
    page.wait_for_selector(".zone-head >> text=now 20.4 °C, set to 21.5 °C")
    page.wait_for_selector("text=/^0.2 °C$/")
    house.step("living")
    eventually(page, "!document.querySelector('.now').textContent.includes('set to')")


def test_what_happens_now_is_told_and_so_is_what_has_passed(serve: Any, visit: Any) -> None:
    house = serve({"living": running("living", 288 + 200)})
    page = opened(visit, house).page
    house.step("living")
    page.wait_for_selector("text=Something acts on the room that nobody measures")
    for _ in range(30):
        house.step("living")
    page.wait_for_selector("text=Nothing speaks against the forecasts now, up to")
    house.step("living", state="stalled", reason="T_out is 1500 s old")
    page.wait_for_selector("text=There is no current forecast; the last one is old.")
    assert page.locator(".pill").inner_text() == "stalled"
    assert page.locator(".doubt li [lang=en]").inner_text() == "T_out is 1500 s old"


def test_trust_is_told_with_its_reason(serve: Any, visit: Any, zone: FakeZone) -> None:
    zone.updates = [update._replace(setpoint=update.y[0]) for update in zone.updates]
    narrow = "the intervals 6 h ahead held 71 % of what came"
    horizons = (HorizonTrust(3600, "trusted", "", START), HorizonTrust(21600, "doubtful", narrow, START))
    zone.trusted = Trust(START, horizons)
    house = serve({"living": zone})
    page = visit(house.url).page
    page.wait_for_selector('[data-zone="living"]')
    assert page.locator('[data-zone="living"] .cell-trust').inner_text() == "doubtful"
    assert page.locator('[data-zone="living"] .cell-finding').inner_text() == narrow
    page.locator('[data-zone="living"] a').click()
    page.wait_for_selector("text=Take the forecast with care 6 h ahead; 1 h ahead, nothing speaks against it.")
    page.wait_for_selector("text=6 h ahead, the forecast is doubtful:")
    assert page.locator(".doubt li [lang=en]").inner_text() == narrow
    acts, beaten = "an open window acts on the room", "24 h ahead, no change is the better forecast"
    doubted = [HorizonTrust(lead, "doubtful", acts, START) for lead in (3600, 21600)]
    zone.trusted = Trust(START, tuple(doubted), disturbed=True, beaten=f"{beaten}; do not rely on the model now")
    page.goto(f"{house.url}#/zone/living")
    page.reload()
    page.wait_for_selector("text=1 h, 6 h ahead, the forecast is doubtful: an open window acts on the room")
    page.wait_for_selector(f"text={beaten}; do not rely on the model now")
    zone.trusted = Trust(
        START, horizons[:1], beaten="6 h ahead, a simple estimate from the last hours is the better forecast"
    )
    page.reload()
    page.wait_for_selector("text=Take the forecast with care where a simpler one is better:")
    page.wait_for_selector(".doubt.warned >> text=a simple estimate from the last hours is the better forecast")


def test_the_daemon_speaks_german_on_the_german_page(serve: Any, visit: Any, zone: FakeZone) -> None:
    reason = "T_out is 1500 s old, older than hold_inputs = 900 s"
    zone.diagnosis = Diagnosis((Finding("parameter-at-bound", "C_i", "a sentence of a newer daemon"),))
    zone.faults = {"ahead_of_time": 2}
    house = serve({"living": zone})
    # The browser logs the 503 that a stalled room answers.
    watched = visit(house.url, locale="de-DE", quiet=False)
    page = watched.page
    page.wait_for_selector('[data-zone="living"]')
    house.step("living", state="stalled", reason=f"{reason}; the wire is cut")
    page.wait_for_selector("text=T_out ist 1500 s alt, älter als hold_inputs = 900 s; the wire is cut")
    page.locator('[data-zone="living"] a').click()
    eventually(page, f"{PLOTTED} >= 1")
    own = page.locator(".doubt li span")
    assert own.inner_text() == "T_out ist 1500 s alt, älter als hold_inputs = 900 s; the wire is cut"
    assert own.get_attribute("lang") == "de"
    page.locator("section details summary").click()
    page.wait_for_selector(".findings li [lang=en]")
    assert page.locator(".findings li [lang=en]").last.inner_text() == "a sentence of a newer daemon"
    page.locator(".expert summary").click()
    page.wait_for_selector("text=Abgelehnte Messwerte: 2 aus der Zukunft")
    assert [url for url in watched.requests if "said-de" in url], "the file of this language"
    page.locator("#language").select_option("en")
    page.wait_for_selector(f"text={reason}; the wire is cut")


def series_of(page: Any) -> list[dict[str, Any]]:
    """What plotly was given to draw."""
    return list(page.evaluate("document.querySelector('.plot.history').data"))


def with_gain(name: str) -> FakeZone:
    """A day of samples with a set-point and unmeasured heat, but for an hour."""
    zone = running(name, 288)
    for index, update in enumerate(zone.updates):
        if index not in range(120, 132):
            gain = Disturbance((-50.0, 100.0 + index, 400.0), 0.9, ((0.04, 0.05, 0.06),))
            zone.updates[index] = update._replace(setpoint=20.0 + (index > 144), disturbance=gain)
    return zone


def test_lines_are_drawn_where_they_are_known_and_named_and_hovering_tells_the_time_in_utc(
    serve: Any, visit: Any
) -> None:
    house = serve({"both": with_gain("both"), "none": running("none", 288)})
    page = opened(visit, house, "none").page
    titles = "document.querySelector('.plot.history').layout.annotations.map(({text}) => text)"
    assert "set-point</extra>" not in str(series_of(page))
    assert "W unmeasured" not in page.evaluate(titles)
    page = opened(visit, house, "both").page
    drawn = {str(one.get("hovertemplate")).rpartition("<extra>")[2]: one["y"] for one in series_of(page)}
    assert {20.0, 21.0} <= set(drawn["set-point</extra>"])
    gain = [value for value in drawn["unmeasured heat</extra>"] if value is not None]
    assert (min(gain), max(gain)) == (100.0, 387.0)
    assert "W unmeasured" in page.evaluate(titles)
    names = ["forecast before", "measured", "set-point", "Outdoors", "Next door", "Heating", "unmeasured heat"]
    assert page.locator(".legend").first.locator("li").all_inner_texts() == names
    page.locator(".expert summary").click()
    eventually(page, "document.querySelector('.legend').textContent.endsWith('αgate')")
    drawn_high = "document.querySelector('.plot.history .main-svg').getBoundingClientRect().height"
    whole = "document.querySelector('.plot.history').getBoundingClientRect().height"
    assert page.evaluate(f"{drawn_high} === {whole}"), "two panels more are higher"
    page.locator(".plan-box button", has_text="Off", has_not_text="until").click()
    eventually(page, "document.querySelectorAll('.legend')[1].textContent.endsWith('without the plan')")
    assert axe_finds(page) == []
    for plot in (".plot.history", ".plot.fan"):
        page.locator(plot).scroll_into_view_if_needed()
        box = page.locator(plot).bounding_box()
        page.mouse.move(box["x"] + box["width"] * 0.5, box["y"] + 60)
        text = f"[...document.querySelectorAll('{plot} .hoverlayer text')].map((one) => one.textContent).join(' ')"
        eventually(page, f"{text}.includes('UTC')")
        told = re.search(r"(\d\d):(\d\d) .* °C.* · 2025-05-\d\d (\d\d):(\d\d) UTC", page.evaluate(text))
        assert told is not None, page.evaluate(text)
        ahead = 60 * (int(told[1]) - int(told[3])) + int(told[2]) - int(told[4])
        assert ahead % 1440 == 120, "Berlin's time, and UTC"


def test_the_fan_says_where_its_inputs_come_from(serve: Any, visit: Any, zone: FakeZone) -> None:
    zone.origins = (
        InputOrigin("T_out", "weather", "forecast", 7200.0, Quality.UNCERTAIN),
        InputOrigin("T_adj", "yesterday", "", 60.0, Quality.UNCERTAIN),
        InputOrigin("u_heat", "held", "", 60.0, Quality.GOOD),
    )
    page = opened(visit, serve({"living": zone})).page
    page.wait_for_selector("text=With the inputs as foreseen below, the lowest is")
    assert page.locator(".origins li").all_inner_texts() == [
        "Outdoors: weather forecast “forecast”, 2 h old, as far as it reaches",
        "Next door: as usual at that hour",
        "Heating: as it is now (measured 60 s ago)",
    ]
    page.locator(".plan-box button", has_text="Off", has_not_text="until").click()
    page.wait_for_selector("text=Heating: as planned")
    page.locator("#language").select_option("de")
    page.wait_for_selector("text=Nebenan: wie um diese Zeit üblich")


MEASURING = """() => {
  window.measured = 0;
  const count = (changes) => changes.forEach(({addedNodes}) => { window.measured += addedNodes.length; });
  new MutationObserver(count).observe(document.getElementById("js-plotly-tester"), {childList: true});
}"""


def test_a_chart_that_is_drawn_again_and_again_keeps_nothing(serve: Any, visit: Any) -> None:
    """In an hour of samples of 5 s a chart is drawn 720 times: 1 MB at 1.4 kB each time."""
    house = serve({"living": running("living", 300)})
    page = opened(visit, house).page
    session = page.context.new_cdp_session(page)
    page.evaluate(MEASURING)

    def step() -> int:
        house.step("living")
        newest = house.zones["living"].updates[-1].time
        eventually(page, f"Date.parse(document.querySelector('.figures time').dateTime) === {newest}000")
        return newest

    def after(samples: int) -> int:
        for _ in range(samples):
            step()
        return held(session)

    before = after(24)
    assert before > 1e6
    assert after(24) < before + 24 * 1400
    # plotly.js keeps the size of every label that it measures, at every place where it measures it.
    for _ in range(4):
        # Two hours ahead of UTC, at the end of the interval.
        end = f"{datetime.fromtimestamp(step() + 300 + 7200, UTC):%Y-%m-%dT%H:%M}"
        page.locator(".controls button", has_text="1 d").click()
        eventually(page, f"document.querySelector('.plot.history').layout.xaxis.range[1].startsWith('{end}')")
    assert page.evaluate("window.measured") == 0
    # That it would have been noticed: an axis that turns its labels where they are long has to measure them.
    page.evaluate("window.Plotly.relayout(document.querySelector('.plot.history'), {'xaxis.tickangle': 'auto'})")
    eventually(page, "window.measured > 0")


def test_plotly_is_asked_for_once_and_only_by_a_room_and_draws_a_gap_as_a_gap(visit: Any, house: Building) -> None:
    page = opened(visit, house).page
    page.goto(f"{house.url}/#/")
    page.wait_for_selector("tr[data-zone]")
    page.goto(f"{house.url}/#/zone/gap")
    eventually(page, f"{PLOTTED} >= 2")
    measured = next(one for one in series_of(page) if "measured" in one.get("hovertemplate", ""))
    assert measured["y"].count(None) == 2, "one break, and the end"
    bands = [one for one in series_of(page) if one.get("fill") == "toself"]
    assert bands[0]["y"].count(None) == 2, "the band is two polygons"
    page.goto("about:blank")
    page.goto(f"{house.url}/#/zone/living")
    eventually(page, f"{PLOTTED} >= 2")
    scripts = page.evaluate("performance.getEntriesByType('resource').filter(({name}) => name.includes('plotly'))")
    assert [one["transferSize"] for one in scripts] == [0], "from the browser's own cache"


def test_ranges_zoom_and_pan_ask_the_server_for_what_is_shown(visit: Any, house: Building) -> None:
    watched = opened(visit, house)
    page = watched.page

    def stretches() -> list[str]:
        return [url for url in watched.requests if "/series?start" in url]

    def asked(act: Any) -> str:
        before = len(stretches())
        act()
        while len(stretches()) == before:
            page.wait_for_timeout(20)
        return stretches()[-1]

    buttons = page.locator(".controls").first
    assert "start=2025-05-03T01%3A00" in asked(lambda: buttons.locator("button", has_text="1 d").click())
    assert "start=2024-05-04T01%3A00" in asked(lambda: buttons.locator("button", has_text="1 y").click())
    assert "start=2025-05-04T00%3A00" in asked(lambda: buttons.locator("button", has_text="1 h").click())
    earlier = asked(lambda: buttons.locator("button", has_text="←").click())
    assert "start=2025-05-03T23%3A30" in earlier
    assert "end=2025-05-04T00%3A30" in earlier
    day = asked(lambda: buttons.locator("input[type=date]").fill("2025-05-03"))
    assert "start=2025-05-02T22%3A00" in day, "the day of the site, which is two hours ahead of UTC"
    page.wait_for_selector("text=Measured from Sat, May 3, 00:00 to Sun, May 4, 00:00:")
    page.locator(".plot.history").scroll_into_view_if_needed()
    eventually(page, "document.querySelector('.plot.history').layout.xaxis.range[0].startsWith('2025-05-03T00:00')")
    assert asked(lambda: drag(page, ".plot.history", (0.4, 0.3), (0.6, 0.3))) != day


def test_an_answer_that_comes_late_does_not_move_what_was_asked_for_since(visit: Any, house: Building) -> None:
    page = opened(visit, house).page
    held: list[Any] = []
    asked: list[str] = []

    def answer(route: Any) -> None:
        asked.append(route.request.url)
        if held:
            route.continue_()
        else:
            held.append(route)

    page.route("**/series?start=**", answer)
    # Long enough between what a person asks for and the request for another answer to come in between.
    page.evaluate(
        "() => { const real = setTimeout; window.setTimeout = (run, pause) => real(run, Math.max(pause, 1000)); }"
    )
    buttons = page.locator(".controls").first
    buttons.locator("button", has_text="←").click()
    while not held:
        page.wait_for_timeout(20)
    buttons.locator("input[type=date]").fill("2025-05-03")
    held[0].continue_()
    while len(asked) < 2:
        page.wait_for_timeout(20)
    assert "start=2025-05-02T22%3A00" in asked[1]


def test_the_plan_is_made_by_hand_and_the_fan_follows(visit: Any, house: Building) -> None:
    page = opened(visit, house).page
    zone = house.zones["living"]
    page.wait_for_selector("text=With everything as it is now, the lowest is")
    zone.asked.clear()
    page.locator(".plan-box input[type=number]").fill("2000")
    page.locator(".plan-box input[type=number]").press("Tab")
    drag(page, ".plan", (0.25, 0.5), (0.5, 0.5))
    page.wait_for_selector("text=Under this plan, the lowest is")
    plan = [one for one in zone.asked if one[0] == "fan" and one[3]][-1][3]["u_heat"]
    assert len(plan) == 288
    assert max(plan) == 1000.0, "half of the height is half of the power"
    assert plan[-1] == pytest.approx(5.5), "what was not drawn is as now"
    page.locator(".plan g").first.focus()
    page.keyboard.press("End")
    eventually(page, "document.querySelector('.plan g').getAttribute('aria-valuenow') === '2000'")
    page.locator(".plan-box button", has_text="No plan").click()
    page.wait_for_selector("text=With everything as it is now")


def test_set_points_are_planned_where_the_law_of_the_thermostat_is_known(serve: Any, visit: Any) -> None:
    zone, half = with_gain("living"), Range(0.25, 0.2, 0.3)
    zone.laws = (LearnedLaw("u_heat", "heating", "proportional", Range(1500.0, 1400.0, 1600.0), half, half, 0.9, 14),)
    zone.surroundings = Surroundings({"T_set": (5.0, 35.0)})
    more = PlanOutcome("planned", Range(2.14, -0.3, 4.5), None, Range(-1.2, -2.0, 0.0))
    zone.answers = {
        DemandQuestion: Called(Demand(START, "trusted", 86400.0, False, Range(12.34, 10.0, 14.5), []), None),
        CompareQuestion: Comparison(START, "trusted", 86400.0, [], [more]),
    }
    # The browser logs what is refused.
    page = opened(visit, serve({"living": zone}), quiet=False).page
    page.wait_for_selector("text=the thermostat calls for 12.3 kWh of heat (95 %: 10.0 to 14.5).")
    page.get_by_label("Planned channel").select_option("T_set")
    drag(page, ".plan", (0.25, 0.2), (0.5, 0.2))
    page.wait_for_selector("text=by +2.1 kWh (95 %: -0.3 to +4.5), and the time more than 0.5 K below them by -1.2 h (")
    plan = [one for one in zone.asked if one[0] == "fan" and one[3]][-1][3]["T_set"]
    assert (max(plan), plan[-1]) == (25.0, 21.0), "four fifths of the way from 5 to 30 degC; else as now"
    assert "Thermostat, Heating (proportional): 1,500 (1,400 … 1,600) W, half of it 0.25 (0.2" in page.content()
    likeliest, planned = [one for one in zone.asked if isinstance(one, CompareQuestion)][-1].courses
    assert planned.setpoints.tolist() == plan
    assert likeliest.setpoints.times > zone.updates[-1].forecast.valid_time + 86400, "it plans nothing so far"
    page.locator(".plan-box button", has_text="No plan").click()
    page.locator("text=Against the likeliest set-points").wait_for(state="detached")
    zone.trusted = Trust(START, (HorizonTrust(86400, "untrusted", "too narrow", START),))
    page.reload()
    page.wait_for_selector("text=How much heat that takes is not known: zone 'living' is not trusted 24 h ahead")


def test_off_until_seven_moves_on_with_the_time(serve: Any, visit: Any) -> None:
    house = serve({"living": running("living", 300)})
    page = opened(visit, house, before=lambda page: page.clock.install()).page
    page.wait_for_selector("text=With everything as it is now, the lowest is")
    first = ".plan g"
    # The newest sample ends at 01:00 UTC, which is 03:00 at the site.
    assert page.locator(first).first.get_attribute("aria-label") == "from Sun, May 4, 03:00"
    page.locator(".plan-box input[type=time]").fill("07:00")
    page.locator(".plan-box button", has_text="Off until").click()
    page.wait_for_selector("text=Under this plan, the lowest is")
    plan = [one for one in house.zones["living"].asked if one[0] == "fan" and one[3]][-1][3]["u_heat"]
    assert (plan[:48], set(plan[48:])) == ([0.0] * 48, {5.5}), "four hours off"
    assert page.locator(".plan-then").inner_text() == "From 07:00 on 5.5 W; drag the bars for something else."
    page.locator(first).nth(3).focus()
    for _ in range(24):
        house.step("living")
    eventually(page, "document.querySelector('.figures time').dateTime.startsWith('2025-05-04T02:55')")
    page.clock.fast_forward(31_000)
    eventually(page, f"document.querySelector('{first}').getAttribute('aria-label') === 'from Sun, May 4, 05:00'")
    heights = [one.get_attribute("aria-valuenow") for one in page.locator(first).all()]
    assert heights == ["0", "0", *["6"] * 22], "still off until seven"
    assert page.evaluate("document.activeElement.getAttribute('aria-label')") == "from Sun, May 4, 06:00"


def test_a_plan_that_is_refused_stands_beside_no_other_fan_and_is_forgotten_once_one_is_not(
    visit: Any, house: Building
) -> None:
    refusals = [{"type": "about:blank", "title": "Unprocessable", "status": 422, "detail": "u_heat plans too much"}]

    def refusing(page: Any) -> None:
        def answer(route: Any) -> None:
            if route.request.method == "POST" and refusals:
                route.fulfill(status=422, content_type="application/problem+json", body=json.dumps(refusals.pop()))
            else:
                route.continue_()

        page.route("**/zones/living/forecast", answer)

    page = opened(visit, house, quiet=False, before=refusing).page
    page.wait_for_selector("text=With everything as it is now, the lowest is")
    page.locator(".plan-box input[type=time]").fill("06:00")
    off = page.locator(".plan-box button", has_text="Off until")
    off.click()
    page.wait_for_selector("[role=alert]:has-text('u_heat plans too much')")
    page.wait_for_selector("text=With everything as it is now, the lowest is")
    off.click()
    page.wait_for_selector("text=Under this plan, the lowest is")
    page.wait_for_selector("[role=alert]", state="hidden")


def test_a_room_that_cannot_be_shown_says_why(visit: Any, house: Building) -> None:
    def failing(page: Any) -> None:
        page.route("**/zones/living", lambda route: route.fulfill(status=503, body="busy"), times=1)

    # The browser logs what is answered with an error.
    page = visit(house.url, "/#/zone/living", quiet=False, before=failing).page
    page.wait_for_selector("h1:has-text('living')")
    page.wait_for_selector("text=With everything as it is now, the lowest is")
    page.goto(f"{house.url}/#/zone/attic")
    page.wait_for_selector("text=There is no forecast yet.")
    page.wait_for_selector("text=no reading of T_out yet")
    page.goto(f"{house.url}/#/zone/nowhere")
    page.wait_for_selector("text=there is no zone 'nowhere'")
    page.locator("main a").click()
    page.wait_for_selector("tr[data-zone]")


def hostile_network() -> Network:
    """A network in which every name is an attack."""
    node, wall, heat = f"n{HOSTILE}", f"b{HOSTILE}", f"u{HOSTILE}"
    return Network(
        name=HOSTILE,
        capacitances={node: f"C{HOSTILE}"},
        boundaries=[wall],
        conductances=[Conductance(f"U{HOSTILE}", (node, wall))],
        heat_inputs=[HeatInput(heat, node)],
        parameters=[
            Parameter(f"C{HOSTILE}", "J/K", 1e5, 1e7, 1e6),
            Parameter(f"U{HOSTILE}", "W/K", 10.0, 1000.0, 100.0),
        ],
        measured=[node],
        description=HOSTILE,
    )


def test_hostile_names_are_text_wherever_they_show(serve: Any, visit: Any) -> None:
    network = hostile_network()
    zone = replace(running(HOSTILE), network=network, updates=[make_update(step, network) for step in range(40)])
    zone.reason = HOSTILE
    zone.faults = {HOSTILE: 3}
    zone.diagnosis = Diagnosis((Finding("parameter-at-bound", f"C{HOSTILE}", HOSTILE),))
    page = visit(serve({HOSTILE: zone}, site=HOSTILE).url).page
    page.wait_for_selector("tr[data-zone] a")
    assert page.locator("tr[data-zone] a").inner_text() == HOSTILE
    page.locator("tr[data-zone] a").click()
    eventually(page, f"{PLOTTED} >= 2")
    page.locator(".expert summary").click()
    page.wait_for_selector(".plan-box")
    page.locator(".plot.history").scroll_into_view_if_needed()
    box = page.locator(".plot.history").bounding_box()
    page.mouse.move(box["x"] + box["width"] * 0.9, box["y"] + 60)
    page.wait_for_selector(".hoverlayer text", state="attached")
    assert page.evaluate("window.hacked") is None
    assert page.locator("img").count() == 0
    assert page.locator("h1").inner_text() == HOSTILE
    assert HOSTILE in page.locator("#site").inner_text()
