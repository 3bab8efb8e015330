"""Charts of a report: what is drawn, what stands beside it, and how little room it takes."""

import re
from datetime import UTC, datetime

import numpy as np
from support.tables import tabled

from replay.reports.kit.chart import Band, Bars, Chart, Level, Line, Panel
from replay.reports.language import sayer


def seconds(*moment):
    return datetime(*moment, tzinfo=UTC).timestamp()


def drawn(chart):
    """Class and path of everything that is drawn, the grid apart."""
    return re.findall(r"<path class='(?!grid)([^']*)' d='([^']*)'/>", chart.html("title"))


def texts(chart, place):
    found = re.findall(rf"<div class='{place}' aria-hidden='true'>(.*?)</div>", chart.html("title"))
    return next(re.sub("<[^>]*>", " ", one).split("  ") for one in found)


def test_a_line_ends_at_a_gap_and_a_single_point_shows():
    line = Line("T", "ink", np.arange(5.0), np.array([0.0, 1.0, np.nan, 0.5, np.nan]))
    ((kind, path),) = drawn(Chart([Panel([line], range=(0.0, 1.0))], "h"))
    assert kind == "line ink"
    assert path == "M0 1000l500 -1000M1500 500h0"


def test_a_band_has_a_gap_where_either_end_is_unknown():
    x, lower = np.arange(5.0), np.array([0.0, 0.0, np.nan, 0.0, 0.0])
    ((_, path),) = drawn(Chart([Panel([Band("95 %", x, lower, np.ones(5))])], "h"))
    assert path.count("M") == path.count("z") == 2


def test_what_is_wild_is_cut_off_and_what_is_flat_or_unknown_is_drawn():
    x = np.arange(3.0)
    wild = Line("T", "ink", x, np.array([20.0, 1e300, -np.inf]))
    ((_, path),) = drawn(Chart([Panel([wild], range=(19.0, 21.0))], "h"))
    assert max(abs(int(number)) for number in re.findall(r"-?\d+", path)) <= 4000
    for values in (np.full(3, 5.0), np.full(3, np.nan)):
        assert "NaN" not in Chart([Panel([Line("T", "ink", x, values)])], "h").html("title")


def test_bars_stand_on_each_other():
    x, low, high = np.arange(2.0), np.array([1.0, np.nan]), np.array([2.0, 4.0])
    bars = Bars("a", "blue", x, low, 0.5, np.zeros(2)), Bars("b", "warm", x, high, 0.5, np.nan_to_num(low))
    (_, below), (_, above) = drawn(Chart([Panel(bars, range=(0.0, 4.0))], "h"))
    assert re.findall(r"M\d+ (\d+)V(\d+)", below) == [("1000", "750"), ("1000", "1000")]
    assert re.findall(r"M\d+ (\d+)V(\d+)", above) == [("750", "250"), ("1000", "0")]


@tabled
def test_times_are_round_and_the_axis_has_the_year(begin, end, marks):
    x = np.array([seconds(*begin), seconds(*end)])
    chart = Chart([Panel([Line("T", "ink", x, x)])], "Europe/Berlin", dated=True)
    found = [text.strip() for text in texts(chart, "below")]
    assert 3 <= len(found) <= 13
    if marks is not None:
        assert found == marks
    years = "–".join(dict.fromkeys((str(begin[0]), str(end[0]))))
    assert f"Europe/Berlin, {years}<" in chart.html("title")


def test_months_and_decimals_are_those_of_the_language():
    x = np.array([seconds(2016, 12, 30), seconds(2017, 7, 2)])
    chart = Chart([Panel([Line("sun", "ink", x, np.array([0.0, 1.0]))])], "UTC", dated=True, say=sayer("de"))
    page = chart.html("title")
    assert "1. Mai" in page
    assert ">0,5<" in page
    assert "Sonne</li>" in page
    assert "UTC, 2016–2017<" in page


def test_logarithms_have_round_levels_within_the_panel():
    line = Line("C", "blue", np.arange(3.0), np.array([1e5, 3e5, 2e6]))
    chart = Chart([Panel([line, Level(1e4), Level(1e7)], log=True)], "h")
    assert [text.strip() for text in texts(chart, "levels")] == ["10000", "100000", "1e6", "1e7"]
    assert len(drawn(chart)) == 3


def test_a_long_line_takes_little_room():
    x = np.arange(2500.0)
    line = Line("T", "ink", x, 20.0 + np.sin(x / 50.0) + 0.05 * np.random.default_rng(1).standard_normal(2500))
    assert len(Chart([Panel([line])], "h").html("title")) < 30_000
