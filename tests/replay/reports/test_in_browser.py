"""The page of a report in a real browser, without a network."""

import shutil
from pathlib import Path

import pytest
from support.browser import axe_finds, browser

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
    if shutil.which("chromium") is None:
        pytest.skip("Debian's chromium is not installed")
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


def test_plots_are_drawn_when_they_come_near_and_nothing_is_fetched(page):
    page.wait_for_function("document.querySelectorAll('.plot .main-svg').length > 0")
    waiting = "document.querySelectorAll('.plot > script').length"
    assert page.evaluate(waiting) > 7, "those of the second zone are far below"
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.wait_for_function(f"{waiting} === 0")
    page.wait_for_function("[...document.querySelectorAll('.plot')].every((plot) => plot.querySelector('.main-svg'))")
    assert page.said == []
    assert len(page.asked) == 1, "the page itself"


@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_is_wider_than_the_window(page, width):
    page.set_viewport_size({"width": width, "height": 800})
    page.wait_for_function("document.documentElement.scrollWidth <= innerWidth")


def test_axe_finds_nothing(page):
    assert axe_finds(page) == []


def test_at_night_it_is_dark_and_on_paper_light(page):
    background = "getComputedStyle(document.body).backgroundColor"
    first = "document.querySelector('.plot .main-svg').style.background"
    page.emulate_media(color_scheme="dark")
    page.wait_for_function(f"{background} === 'rgb(20, 23, 26)'")
    page.wait_for_function(f"{first} === 'rgb(20, 23, 26)'")
    assert axe_finds(page) == []
    page.emulate_media(media="print", color_scheme="dark")
    page.wait_for_function(f"{background} === 'rgb(255, 255, 255)'")
    page.wait_for_function(f"{first} === 'white'")
    parted = page.evaluate("[...document.querySelectorAll('figure')].map(one => getComputedStyle(one).breakInside)")
    assert set(parted) == {"avoid"}, "no plot is cut by the end of a sheet"
    page.emulate_media(media="screen", color_scheme="light")
    assert page.said == []


def test_it_prints_whole_as_a_small_pdf(page):
    printed = page.pdf()
    assert printed.startswith(b"%PDF")
    assert len(printed) < 2_000_000
    assert page.evaluate("document.querySelectorAll('.plot > script').length") == 0, "every plot was drawn"
    assert page.said == []
