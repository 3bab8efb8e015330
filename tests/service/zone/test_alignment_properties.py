from itertools import pairwise
from math import inf, isfinite, isnan, nan

from hypothesis import given, settings
from hypothesis import strategies as st

from adapters.reading import Fault, Quality, Reading
from estimator.network.presets import network
from service.zone.alignment import Alignment, Rules

TITE = network("tite")
PERIOD, IDLE_LIMIT = 60, 4

moments = st.floats(0, 3000) | st.sampled_from([0.0, 59.999, 60.0, 120.0, -5.0, nan, inf, -inf, 1e300])
values = st.floats(-50, 50) | st.sampled_from([nan, inf, -inf, 1.7e308, -1.7e308])
qualities = st.sampled_from([*[Quality.GOOD] * 4, Quality.UNCERTAIN, Quality.BAD])
faults = st.sampled_from([*[None] * 10, *Fault])
readings = st.builds(Reading, st.sampled_from(TITE.channels), moments, values, qualities, faults)
batches = st.lists(st.tuples(st.sampled_from("ab"), st.lists(readings, max_size=12), moments), max_size=12)


def usable(reading):
    return (
        0 <= reading.time < 1e9
        and isfinite(reading.value)
        and reading.quality is not Quality.BAD
        and reading.fault is None
    )


def aligned(rounds, rule):
    align = Alignment(TITE, PERIOD, "ab", Rules(dict.fromkeys(TITE.channels, rule), idle_limit=IDLE_LIMIT))
    samples = [sample for source, batch, now in rounds for sample in align.add(source, batch, now)]
    return align, [*samples, *align.end("a"), *align.end("b")]


def cells(sample):
    return list(
        zip(
            TITE.channels,
            [*sample.outputs, *sample.inputs],
            [*sample.output_quality, *sample.input_quality],
            strict=True,
        )
    )


@settings(deadline=None, max_examples=60)
@given(batches)
def test_whatever_comes_samples_lie_on_the_grid_and_rise_in_time(rounds):
    _, samples = aligned(rounds, "mean")
    times = [sample.time for sample in samples]
    assert all(earlier < later for earlier, later in pairwise(times))
    assert all(time % PERIOD == 0 for time in times)
    silent = 0
    for sample in samples:
        silent = silent + 1 if all(quality is Quality.BAD for _, _, quality in cells(sample)) else 0
        assert silent <= IDLE_LIMIT


@settings(deadline=None, max_examples=150)
@given(rule=st.sampled_from(["mean", "time_weighted", "first", "last", "min", "max"]), rounds=batches)
def test_a_value_lies_within_the_readings_of_its_interval_and_bad_means_none(rule, rounds):
    _, samples = aligned(rounds, rule)
    for sample in samples:
        for channel, value, quality in cells(sample):
            assert isnan(value) == (quality is Quality.BAD)
            if quality is Quality.BAD:
                continue
            candidates = [
                reading.value
                for _, batch, _ in rounds
                for reading in batch
                if reading.channel == channel and sample.time <= reading.time < sample.time + PERIOD and usable(reading)
            ]
            assert min(candidates) <= value <= max(candidates)


@settings(deadline=None, max_examples=60)
@given(st.lists(readings, max_size=60))
def test_every_reading_is_used_counted_or_bad_without_a_reason(everything):
    align, samples = aligned([("a", everything, nan)], "mean")
    used = {(reading.channel, reading.time) for reading in everything if usable(reading)}
    silent = sum(r.quality is Quality.BAD and r.fault is None and 0 <= r.time < 1e9 for r in everything)
    assert len(used) + align.faults.total() + silent == len(everything)
    assert {time // PERIOD * PERIOD for _, time in used} <= {sample.time for sample in samples}


plain = st.builds(Reading, st.just("T_i"), st.floats(0, 3000), st.floats(-50, 50), st.just(Quality.GOOD), st.none())


@settings(deadline=None, max_examples=60)
@given(st.lists(plain, unique_by=lambda reading: reading.time))
def test_the_order_of_arrival_inside_open_intervals_does_not_matter(unordered):
    for rule in ("mean", "time_weighted", "sum", "first", "last"):
        _, samples = aligned([("a", unordered, nan)], rule)
        _, ordered = aligned([("a", [reading], nan) for reading in sorted(unordered, key=lambda r: r.time)], rule)
        assert [(sample.time, str(sample.outputs)) for sample in samples] == [
            (sample.time, str(sample.outputs)) for sample in ordered
        ]
