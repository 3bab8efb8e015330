"""The page of a report in a real browser, without a network."""

from datetime import UTC, datetime
from pathlib import Path

import pytest
from support.browser import axe_finds, browser
from support.processes import program

from replay.recorded.runner import replay_recording
from replay.reports.publish import publish_report
from service.config.load import load

EXAMPLE = Path(__file__).parents[3] / "deploy" / "examples" / "building-67.toml"
ZONE = "building-67"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A tab with the report of two zones."""
    pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")
    pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe looks at the page")
    program("chromium", "chromium")
    out = tmp_path_factory.mktemp("report")
    settings = [f'zones.{ZONE}.estimator="mkf"', f"zones.{ZONE}.estimator_options={{particles=16}}"]
    (trace,) = replay_recording(load(EXAMPLE, settings), out, progress=False)
    publish_report("site", [trace, trace._replace(zone="second")], out)
    with browser() as launched:
        tab = launched.new_context(offline=True).new_page()
        tab.said, tab.asked = [], []
        tab.on("console", lambda message: tab.said.append(message.text))
        tab.on("pageerror", lambda error: tab.said.append(str(error)))
        tab.on("request", lambda request: tab.asked.append(request.url))
        tab.goto((out / "report.html").as_uri())
        yield tab


def test_charts_are_there_at_once_and_nothing_is_fetched(page):
    assert page.evaluate("document.querySelectorAll('.place > svg').length") > 14
    assert page.said == []
    assert len(page.asked) == 1, "the page itself"


def test_below_a_chart_stands_what_its_axes_say_where_the_pointer_is(page):
    panel = page.locator(".chart[data-dated] .place").first
    panel.locator("svg").hover()
    told = page.locator(".chart[data-dated] + .axis output").first.text_content()
    low, high = map(float, panel.get_attribute("data-y").split())
    assert low <= float(told.split(": ")[-1]) <= high
    begin, end = page.evaluate("document.querySelector('.chart[data-dated]').dataset.x.split(' ').map(Number)")
    assert f"{datetime.fromtimestamp((begin + end) / 2.0, UTC):%-d}" in told


@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_is_wider_than_the_window(page, width):
    page.set_viewport_size({"width": width, "height": 800})
    page.wait_for_function("document.documentElement.scrollWidth <= innerWidth")


def test_axe_finds_nothing(page):
    assert axe_finds(page) == []


def test_at_night_it_is_dark_and_on_paper_light(page):
    background = "getComputedStyle(document.body).backgroundColor"
    first = "getComputedStyle(document.querySelector('.place .ink')).stroke"
    page.emulate_media(color_scheme="dark")
    page.wait_for_function(f"{background} === 'rgb(20, 23, 26)'")
    page.wait_for_function(f"{first} === 'rgb(228, 231, 234)'")
    assert axe_finds(page) == []
    page.emulate_media(media="print", color_scheme="dark")
    page.wait_for_function(f"{background} === 'rgb(255, 255, 255)'")
    page.wait_for_function(f"{first} === 'rgb(27, 36, 48)'")
    parted = page.evaluate("[...document.querySelectorAll('figure')].map(one => getComputedStyle(one).breakInside)")
    assert set(parted) == {"avoid"}, "no plot is cut by the end of a sheet"
    page.emulate_media(media="screen", color_scheme="light")
    assert page.said == []


def test_it_prints_whole_as_a_small_pdf(page):
    printed = page.pdf()
    assert printed.startswith(b"%PDF")
    assert len(printed) < 2_000_000
    assert page.said == []
