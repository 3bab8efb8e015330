"""The worker: what is published is what is scored, and every kind of gap has its defined outcome."""

import math
import threading
from itertools import pairwise

import pytest
from support.forecasts import fan_of
from support.zone_samples import NAN, PERIOD, comparable, sample, worker

from adapters.reading import Quality
from estimator.loop import VANISHED_LIMIT


@pytest.fixture
def zone():
    return worker()


def run(zone, count, first=0):
    return [zone.step(sample(k)) for k in range(first, first + count)]


def test_the_first_sample_starts_a_segment_and_is_not_scored():
    (update,) = run(worker(), 1)
    assert (update.outcome, update.segment, update.score) == ("started", 1, None)
    assert update.gate.value == 0.0
    assert update.forecast.sample_time == 0
    assert update.forecast.issue_time == update.forecast.valid_time == PERIOD


def test_the_forecast_that_was_published_is_the_one_that_is_scored():
    for before, after in pairwise(run(worker(), 20)):
        (published,) = before.forecast.outputs
        score = after.score
        assert before.forecast.valid_time == after.time
        assert (score.mean[0], score.sd[0]) == (published.mean, published.sd)
        first = published.intervals[0]
        assert (score.lower[0], score.upper[0]) == (first.lower, first.upper)
        assert score.level == 0.95
        assert score.residual[0] == after.y[0] - published.mean
        assert published.intervals[0].lower < published.intervals[1].lower < published.median


def test_the_inputs_of_a_forecast_are_told_with_age_and_quality(zone):
    zone.step(sample(0, quality=Quality.UNCERTAIN))
    outdoor, adjacent, heat = zone.step(sample(1, inputs=[NAN, 18.0, 0.0])).forecast.inputs
    assert (outdoor.channel, outdoor.value, outdoor.unit, outdoor.age) == ("T_out", 5.0, "degC", 300.0)
    assert outdoor.held is True
    assert outdoor.quality is Quality.UNCERTAIN
    assert (adjacent.held, adjacent.age, adjacent.quality) == (False, 0.0, Quality.GOOD)
    assert (heat.value, heat.unit) == (0.0, "W")


def test_a_missing_output_is_bridged_by_prediction(zone):
    run(zone, 10)
    updates = [zone.step(sample(k, y=NAN)) for k in (10, 11, 12)]
    assert [update.outcome for update in updates] == ["missing"] * 3
    assert math.isnan(updates[0].score.residual[0])
    assert updates[2].forecast.outputs[0].sd > updates[0].forecast.outputs[0].sd
    back = zone.step(sample(13))
    assert (back.outcome, back.segment) == ("assimilated", 1)


def test_a_longer_gap_stalls_and_starts_a_new_segment(zone):
    run(zone, 10)
    balance = zone.carried.record.seconds
    for k in range(10, 14):
        last = zone.step(sample(k, y=NAN))
    assert last is None
    assert (zone.carried.record.seconds == balance).all(), "nothing is summed up without a temperature"
    assert "no measurement of T_air for 4 steps" in zone.progress.stalled
    assert fan_of(zone, 0) is None
    back = zone.step(sample(14))
    assert (back.outcome, back.segment, back.score) == ("started", 2, None)
    assert zone.progress.stalled is None


def test_a_missing_input_is_held_up_to_its_age():
    zone = worker(hold_inputs=600.0)
    run(zone, 10)
    held = [zone.step(sample(k, inputs=[NAN, 18.0, 0.0])) for k in (10, 11, 12)]
    assert [update is None for update in held] == [False, False, True]
    assert zone.progress.stalled == "T_out is 900 s old, older than hold_inputs = 600 s"
    assert zone.step(sample(13)).outcome == "started"


def test_an_input_with_an_age_of_its_own_is_held_up_to_that():
    zone = worker(hold_inputs=300.0)
    zone.settings = zone.settings._replace(max_ages={"T_out": 900.0})
    zone.step(sample(0))
    held = [zone.step(sample(k, inputs=[NAN, 18.0, 0.0])) for k in (1, 2, 3)]
    told = [[(one.held, one.age) for one in update.forecast.inputs[:2]] for update in held]
    assert told == [[(True, age), (False, 0.0)] for age in (300.0, 600.0, 900.0)]
    assert zone.step(sample(4, inputs=[NAN, 18.0, 0.0])) is None
    assert zone.progress.stalled == "T_out is 1200 s old, older than its max_age = 900 s"


def test_paper_preprocessing_discards_incomplete_intervals_and_breaks_at_every_gap():
    zone = worker(max_gap=0, hold_inputs=0.0)
    run(zone, 5)
    assert zone.step(sample(5, y=NAN)) is None
    assert zone.step(sample(6)).segment == 2
    assert zone.step(sample(7, inputs=[NAN, 18.0, 0.0])) is None
    assert zone.step(sample(8)).segment == 3
    assert zone.step(sample(9)).outcome == "assimilated"
    assert zone.step(sample(11)).segment == 4


def test_intervals_that_never_came_count_as_missing():
    """A daemon that was down for two intervals goes on as if they had come empty."""
    absent, empty = worker(), worker()
    run(absent, 10)
    run(empty, 10)
    for k in (10, 11):
        empty.step(sample(k, y=NAN, inputs=[NAN, NAN, NAN]))
    assert comparable(absent.step(sample(12))) == comparable(empty.step(sample(12)))


def test_time_must_go_on(zone):
    run(zone, 3)
    with pytest.raises(ValueError, match="does not follow"):
        zone.step(sample(2))


def test_a_sensor_that_jumps_for_good_starts_a_new_segment(zone):
    run(zone, 20)
    outcomes = [zone.step(sample(20 + k, y=60.0)) for k in range(VANISHED_LIMIT + 2)]
    assert [update.outcome for update in outcomes[: VANISHED_LIMIT - 1]] == ["vanished"] * (VANISHED_LIMIT - 1)
    assert all(update.segment == 1 for update in outcomes[: VANISHED_LIMIT - 1])
    assert (outcomes[VANISHED_LIMIT - 1].outcome, outcomes[VANISHED_LIMIT - 1].segment) == ("started", 2)
    # A forecast stood for the sample that starts the segment, so it is scored like every other.
    assert outcomes[VANISHED_LIMIT - 1].score.residual[0] > 30
    assert outcomes[-1].outcome == "assimilated"
    assert outcomes[-1].forecast.outputs[0].mean == pytest.approx(60.0, abs=1.0)


def test_samples_that_are_missing_in_between_do_not_hide_that_a_sensor_has_jumped(zone):
    run(zone, 20)
    outcomes = [zone.step(sample(20 + k, y=60.0 if k % 2 == 0 else NAN)).outcome for k in range(2 * VANISHED_LIMIT)]
    assert outcomes[: 2 * VANISHED_LIMIT - 2] == ["vanished", "missing"] * (VANISHED_LIMIT - 1)
    assert outcomes[2 * VANISHED_LIMIT - 2] == "started"


def test_a_single_outlier_is_passed_over(zone):
    run(zone, 20)
    assert zone.step(sample(20, y=60.0)).outcome == "vanished"
    back = zone.step(sample(21))
    assert (back.outcome, back.segment) == ("assimilated", 1)
    assert zone.progress.vanished == 0


def test_a_question_from_another_thread_never_mixes_two_samples():
    zone = worker(particles=2000)
    run(zone, 3)
    done = threading.Event()
    mixed = []

    def ask():
        while not done.is_set():
            fan = fan_of(zone, 0)
            if fan.outputs[0].mean[0] != fan.update.forecast.outputs[0].mean:
                mixed.append(fan)

    asking = threading.Thread(target=ask)
    asking.start()
    run(zone, 100, first=3)
    done.set()
    asking.join()
    assert not mixed


@pytest.mark.parametrize("name", ["ekf", "ukf"])
def test_an_estimator_without_a_gate_learns_where_it_assimilates_and_nowhere_else(name):
    zone = worker(name)
    updates = [*run(zone, 12), zone.step(sample(12, y=NAN)), zone.step(sample(13, y=70.0))]
    assert [(update.outcome, *update.shown_gate) for update in (*updates[:2], *updates[12:])] == [
        ("started", 0.0, "constant"),
        ("assimilated", 1.0, "constant"),
        ("missing", 0.0, "constant"),
        ("vanished", 0.0, "constant"),
    ]
    assert {(update.gate, update.effective_sample_size) for update in updates} == {(None, None)}
