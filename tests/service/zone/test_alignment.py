from math import inf, isnan, nan

import pytest

from adapters.reading import Fault, Quality, Reading
from estimator.network.presets import network
from service.zone.alignment import Alignment, Rules

TITE = network("tite")  # outputs T_i; inputs T_out, u_heat
GOOD, UNCERTAIN, BAD = Quality.GOOD, Quality.UNCERTAIN, Quality.BAD


def alignment(aggregates=None, sources=("a",), **settings):
    return Alignment(TITE, 300, sources, Rules(aggregates or {}, **settings))


def indoor(time, value=20.0, quality=GOOD, fault=None):
    return Reading("T_i", time, value, quality, fault)


def times(samples):
    return [sample.time for sample in samples]


def measured(samples):
    return [(sample.time, None if isnan(sample.outputs[0]) else float(sample.outputs[0])) for sample in samples]


def test_an_interval_becomes_a_sample_in_the_order_of_the_network():
    align = alignment()
    readings = [
        Reading("u_heat", 310.0, 800.0),
        Reading("u_heat", 300.0, 0.0),
        Reading("T_out", 301.0, 4.0),
        indoor(300.0, 20.0),
        indoor(599.9, 21.0),
    ]
    (sample,) = align.add("a", readings, 600.0)
    assert sample.time == 300
    assert sample.outputs.tolist() == [20.5]
    assert sample.inputs.tolist() == [4.0, 0.0]  # the first power by time, not by arrival
    assert sample.output_quality == (GOOD,)
    assert sample.input_quality == (GOOD, GOOD)


RULES = {"mean": 5.0, "first": 9.0, "last": 5.0, "min": 1.0, "max": 9.0, "sum": 15.0}
WEIGHTED = {"time_weighted": (9 * 30 + 1 * 180 + 5 * 60) / 270}
"""A reading counts until the next one comes, the last until the end."""


@pytest.mark.parametrize(("rule", "expected"), (RULES | WEIGHTED).items())
def test_each_rule(rule, expected):
    readings = [Reading("T_out", 240.0, 5.0), Reading("T_out", 30.0, 9.0), Reading("T_out", 60.0, 1.0)]
    (sample,) = alignment({"T_out": rule}).add("a", readings, 300.0)
    assert sample.inputs[0] == pytest.approx(expected)


def test_a_sum_beyond_all_numbers_is_bad_and_not_infinite():
    readings = [Reading("T_out", 0.0, 1.7e308), Reading("T_out", 1.0, 1.7e308), indoor(0.0)]
    (sample,) = alignment({"T_out": "sum"}).add("a", readings, 300.0)
    assert isnan(sample.inputs[0])
    assert sample.input_quality[0] is BAD


def test_energy_that_no_building_uses_is_refused_as_the_power_that_it_amounts_to():
    align = alignment({"u_heat": "energy"})
    amounts = [Reading("u_heat", 0.0, 1.5e5), Reading("u_heat", 100.0, 1.5e5), Reading("u_heat", 300.0, 1e12)]
    plausible, wrong = align.add("a", amounts, 600.0)
    assert plausible.inputs[1] == 1000.0
    assert isnan(wrong.inputs[1])
    assert wrong.input_quality[1] is BAD
    assert align.faults == {Fault.OUT_OF_RANGE: 1}
    assert align.last_good == {"u_heat": 100.0}


def test_an_interval_stays_open_until_the_clock_reaches_its_end_plus_the_lateness():
    align = alignment(lateness=30.0)
    assert align.add("a", [indoor(0.0, 20.0)], 329.0) == []
    assert align.add("a", [indoor(299.0, 22.0), indoor(305.0, 30.0)], 329.9) == []
    assert measured(align.add("a", [], 330.0)) == [(0, 21.0)]
    assert measured(align.add("a", [indoor(299.5)], 630.0)) == [(300, 30.0)]
    assert align.faults == {Fault.OUT_OF_ORDER: 1}


def test_a_second_reading_of_one_channel_and_time_is_counted_and_the_first_kept():
    align = alignment()
    readings = [indoor(10.0, 20.0), indoor(10.0, 30.0), indoor(10.0, 40.0, UNCERTAIN), Reading("T_out", 10.0, 5.0)]
    (sample,) = align.add("a", readings, 300.0)
    assert sample.outputs[0] == 20.0
    assert sample.output_quality == (GOOD,)
    assert align.faults == {Fault.DUPLICATED: 2}


def test_faulty_readings_are_counted_by_kind_and_never_used():
    align = alignment()
    readings = [indoor(10.0)]
    readings += [indoor(20.0 + i, nan, BAD, fault) for i, fault in enumerate(Fault)]
    readings += [
        indoor(nan, nan, BAD, Fault.NAIVE_TIMESTAMP),
        indoor(nan, 99.0),
        indoor(inf, 99.0),
        indoor(-1.0, 99.0),
        indoor(1e18, 99.0),
        indoor(40.0, inf),
        indoor(41.0, nan, UNCERTAIN),
        indoor(42.0, 99.0, BAD),
    ]
    assert measured(align.add("a", readings, 300.0)) == [(0, 20.0)]
    expected = dict.fromkeys(Fault, 1) | {Fault.NAIVE_TIMESTAMP: 2, Fault.BAD_TIMESTAMP: 5, Fault.NOT_FINITE: 3}
    assert align.faults == expected


def test_quality_is_uncertain_where_a_reading_that_is_used_is():
    readings = [
        indoor(10.0, 20.0),
        indoor(20.0, 22.0, UNCERTAIN),
        Reading("u_heat", 10.0, 800.0),
        Reading("u_heat", 20.0, 0.0, UNCERTAIN),
        Reading("T_out", 10.0, 4.0, UNCERTAIN),
    ]
    (sample,) = alignment().add("a", readings, 300.0)
    assert sample.outputs[0] == 21.0
    assert sample.output_quality == (UNCERTAIN,)
    assert sample.input_quality == (UNCERTAIN, GOOD)  # the uncertain power is not the first


def test_empty_intervals_become_nan_at_once_but_only_so_many():
    align = alignment(idle_limit=3)
    assert times(align.add("a", [indoor(0.0)], 300.0)) == [0]
    silent = align.add("a", [], 900.0)
    assert measured(silent) == [(300, None), (600, None)]
    assert silent[0].output_quality == (BAD,)
    assert silent[0].input_quality == (BAD, BAD)
    assert times(align.add("a", [], 6000.0)) == [900]
    assert align.add("a", [], 9000.0) == []
    assert measured(align.add("a", [indoor(9100.0, 21.0)], 9300.0)) == [(9000, 21.0)]
    assert times(align.add("a", [], 30000.0)) == [9300, 9600, 9900]


def test_a_gap_of_weeks_gives_the_same_samples_in_one_batch_as_in_many():
    weeks = 3 * 7 * 86400
    readings = [indoor(10.0), indoor(weeks), indoor(weeks + 400)]
    whole = alignment(idle_limit=12)
    at_once = whole.add("a", readings, readings[-1].time) + whole.end("a")
    gradual = alignment(idle_limit=12)
    in_between = [sample for now in range(600, weeks, 1000) for sample in gradual.add("a", readings[:1], now)]
    assert gradual.faults.total() > 1000  # the first reading again and again, after its interval closed
    assert times(at_once) == [*range(0, 13 * 300, 300), weeks, weeks + 300]
    assert measured(in_between + gradual.add("a", readings[1:], weeks + 400) + gradual.end("a")) == measured(at_once)


def test_readings_older_than_the_clock_are_out_of_order_even_before_the_first_sample():
    align = alignment()
    assert align.add("a", [], 3600.0) == []
    assert align.add("a", [indoor(10.0)], 3600.0) == []
    assert align.faults == {Fault.OUT_OF_ORDER: 1}


def test_an_interval_with_nothing_but_faults_counts_as_empty():
    align = alignment(idle_limit=1)
    assert align.add("a", [indoor(0.0, nan, BAD, Fault.NON_NUMERIC)], 300.0) == []
    assert times(align.add("a", [indoor(300.0)], 600.0)) == [300]
    broken = [indoor(600.0 + 10 * i, nan, BAD, Fault.OUT_OF_RANGE) for i in range(90)]
    assert measured(align.add("a", broken, 1500.0)) == [(600, None)]


def test_the_slowest_source_sets_the_clock_until_it_ends():
    align = alignment(sources=["a", "b"])
    assert align.add("a", [indoor(0.0), indoor(300.0), indoor(650.0)], 700.0) == []
    assert times(align.add("b", [Reading("T_out", 10.0, 4.0)], 310.0)) == [0]
    assert align.add("b", [Reading("T_out", 320.0, 5.0)], 320.0) == []
    (sample,) = align.end("b")
    assert (sample.time, sample.inputs[0]) == (300, 5.0)
    assert times(align.end("a")) == [600]
    assert align.end("a") == []


def test_flush_closes_the_interval_of_the_last_reading_and_nothing_after_it():
    align = alignment()
    align.add("a", [indoor(0.0), indoor(301.0)], 301.0)
    assert times(align.flush()) == [300]
    assert align.flush() == []
    assert align.add("a", [indoor(302.0)], 303.0) == []
    assert align.faults == {Fault.OUT_OF_ORDER: 1}
    assert alignment().flush() == []


def test_after_a_restart_what_was_processed_is_passed_over_in_silence():
    align = alignment(resume_after=600, idle_limit=3)
    replayed = [indoor(0.0), indoor(899.0), indoor(601.0, nan, BAD, Fault.NON_NUMERIC), indoor(905.0, 21.0)]
    assert measured(align.add("a", replayed, 1200.0)) == [(900, 21.0)]
    assert not align.faults
    align.add("a", [indoor(910.0), indoor(600.0)], 1200.0)
    assert align.faults == {Fault.OUT_OF_ORDER: 1}
    live = alignment(resume_after=600, live=True)
    live.add("a", replayed[:2], 700.0)
    assert live.faults == {Fault.OUT_OF_ORDER: 2}, "live telemetry comes once: its clock was set back"


def test_the_age_of_a_channel_follows_from_the_newest_reading_that_entered_a_sample():
    align = alignment()
    align.add("a", [indoor(10.0), indoor(250.0), Reading("T_out", 20.0, 5.0), indoor(310.0)], 320.0)
    assert align.last_good == {"T_i": 250.0, "T_out": 20.0}
    align.end("a")
    assert align.last_good == {"T_i": 310.0, "T_out": 20.0}


def test_a_set_point_comes_with_the_samples_and_holds_for_a_while():
    align = alignment(sources=("a",), setpoint_age=600.0, idle_limit=9)

    def meant(time, value):
        return Reading("setpoint", time, value)

    samples = align.add("a", [indoor(0), meant(10, 20.0), meant(20, 22.0), indoor(300), indoor(600), indoor(900)], 1500)
    assert [sample.setpoint for sample in samples[:3]] == [21.0, 21.0, 21.0], "its mean, and two periods more"
    assert isnan(samples[3].setpoint), "older than 600 s"
    assert all(len(sample.inputs) == 2 for sample in samples)


@pytest.mark.parametrize("at_once", [True, False])
def test_a_setpoint_holds_over_a_gap_however_readings_are_batched(at_once):
    align = alignment(sources=("a",), setpoint_age=86400.0, idle_limit=9)
    rows = [(k, [indoor(300.0 * k), Reading("setpoint", 300.0 * k, 21.0)]) for k in (3, 4, 9, 10)]
    rows.append((11, [Reading("setpoint", 3300.0, 19.0)]))
    samples = []
    if at_once:
        samples = align.add("a", [reading for _, readings in rows for reading in readings], 3900.0)
    else:
        for k, readings in rows:
            samples += align.add("a", readings, 300.0 * k)
        samples += align.add("a", [], 3900.0)
    assert [sample.setpoint for sample in samples] == [21.0] * 8 + [19.0] * 2


def test_a_set_point_makes_no_sample_and_wakes_no_silent_zone():
    align = alignment(sources=("a",), setpoint_age=0.0, idle_limit=1)
    assert align.add("a", [Reading("setpoint", 10.0, 21.0)], 900) == []
    first, silent = align.add("a", [indoor(900), Reading("setpoint", 1300, 19.0)], 2700)
    assert (times([first, silent]), isnan(first.setpoint), silent.setpoint) == ([900, 1200], True, 19.0)
    assert align.add("a", [Reading("setpoint", 2710, 19.0)], 3300) == []
    assert align.last_good["setpoint"] == 2710.0
