"""Raw numbers to readings: counters, what is believable, and sensors that are stuck."""

import math

import pytest

from adapters.edge import Converter, Edge, LiveConverter
from adapters.reading import Fault, Quality
from adapters.units import conversion

BELIEVABLE = (-1e6, 1e6)
KWH = Edge(conversion=conversion("kWh", "W"), valid=BELIEVABLE, counter=True)


def powers(edge, rows, **settings):
    converter = Converter("z/u", edge, **settings)
    return [converter.reading(time, raw) for time, raw in rows]


def test_a_counter_becomes_the_mean_power_of_every_stretch():
    nothing, first, second = powers(KWH, [(0.0, 100.0), (900.0, 100.5), (1800.0, 100.5)])
    assert nothing is None, "one stand of a counter is no power"
    assert (first.time, first.value) == (0.0, 2000.0)
    assert (second.time, second.value) == (900.0, 0.0)


def test_a_counter_that_rolls_over_goes_on_counting():
    edge = Edge(scale=0.01, conversion=conversion("kWh", "W"), valid=BELIEVABLE, counter=True, rollover=65536.0)
    *_, reading = powers(edge, [(0.0, 65530.0), (600.0, 4.0)])
    assert reading.value == pytest.approx(10 * 0.01 * 3.6e6 / 600)


@pytest.mark.parametrize(
    ("rollover", "before", "after"),
    [(None, 65530.0, 4.0), (65536.0, 20000.0, 0.0), (65536.0, 40000.0, 10000.0)],
    ids=["no rollover known", "set back to 0", "far too much for one stretch"],
)
def test_a_counter_that_is_reset_is_no_huge_power(rollover, before, after):
    edge = Edge(conversion=conversion("kWh", "W"), valid=BELIEVABLE, counter=True, rollover=rollover)
    *_, reset, next_one = powers(edge, [(0.0, before), (600.0, after), (1200.0, after + 0.5)])
    assert (reset.quality, reset.fault) == (Quality.BAD, Fault.COUNTER_RESET)
    assert next_one.value == pytest.approx(0.5 * 3.6e6 / 600), "it counts on from the new stand"


def test_nothing_is_made_of_a_stretch_that_is_too_long_or_runs_backwards():
    assert powers(KWH, [(0.0, 1.0), (101.0, 2.0)], longest_stretch=100.0) == [None, None]
    assert powers(KWH, [(50.0, 1.0), (50.0, 2.0)]) == [None, None]
    assert powers(KWH, [(50.0, 1.0), (40.0, 2.0)]) == [None, None]


def test_doubt_about_either_stand_is_doubt_about_the_power():
    converter = Converter("z/u", KWH)
    converter.reading(0.0, 1.0, Quality.UNCERTAIN)
    assert converter.reading(600.0, 1.1).quality is Quality.UNCERTAIN
    assert converter.reading(1200.0, 1.2).quality is Quality.GOOD


def test_a_counter_that_is_no_number_leaves_the_last_stand():
    *_, wrong, reading = powers(KWH, [(0.0, 1.0), (600.0, math.nan), (1200.0, 2.0)])
    assert wrong.fault is Fault.NOT_FINITE
    assert (reading.time, reading.value) == (0.0, 3000.0)


@pytest.mark.parametrize(
    ("stuck_after", "expected"),
    [(100.0, ["good", "good", "uncertain", "uncertain", "bad", "good", "good", "uncertain"]), (None, ["good"] * 8)],
)
def test_a_value_that_does_not_move_is_doubted_and_then_refused(stuck_after, expected, monkeypatch):
    converter = LiveConverter("z/T", Edge(), math.inf, stuck_after)
    found = []
    for time, raw in [(0, 5), (99, 5), (100, 5), (199, 5), (200, 5), (201, 6), (300, 6), (301, 6)]:
        monkeypatch.setattr("adapters.edge.monotonic", lambda time=time: time)
        found.append(converter.reading(time, raw).quality)
    assert found == expected
