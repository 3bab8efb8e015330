"""Questions about heating, asked of a zone that has learned a simulated house, and held to what it then does."""

from dataclasses import replace
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from support.forecasts import asked as answer
from support.tables import tabled
from support.thermostat_house import morning, recorded, samples
from support.zone_samples import fed
from support.zone_samples import worker as new

from estimator.network.presets import network
from estimator.thermostat.answers import Amounts
from service.errors import NoLaw, ServiceError
from service.forecast.ahead import NextRise
from service.forecast.foresight import NO_WEATHER
from service.forecast.heating import CompareQuestion, Course, DemandQuestion, PreheatQuestion, moment, together
from service.forecast.plan import Timed
from service.records.record import document
from service.records.sample import Sample

PERIOD, DAILY = 1800, 48
DAYS = 10
MIDNIGHT = 24.0 * DAYS
"""Hours after the first midnight at which the questions are asked."""

USUAL = np.array([morning(MIDNIGHT + step / 2) for step in range(DAILY)])


def fresh(period=PERIOD):
    return new("ekf", "tite", period)


@pytest.fixture(scope="module")
def worker():
    return fed(fresh(), samples(DAYS, PERIOD))


def by_day(worker):
    """The same zone if its set-point were 21 degC still."""
    heating = worker.standing.carried.thermostat._replace(setpoint=21.0)
    carried = worker.standing.carried._replace(thermostat=heating)
    found = fresh()
    found.resume(worker.standing._replace(carried=carried), worker.input_quality, worker.progress, worker.trust)
    return found


def followed(setpoint):
    """Temperatures and heat [W] of the day that follows, where set-points come as `setpoint(hours since midnight)`."""
    truth = recorded(DAYS + 1, PERIOD, lambda hour: morning(hour) if hour < MIDNIGHT else setpoint(hour - MIDNIGHT))
    return truth[0][-DAILY:, 0], truth[1][-DAILY:, 1]


def kilowatt_hours(heat):
    return float(heat.sum()) * PERIOD / 3.6e6


def test_the_next_likely_rise_of_the_set_point_is_prepared_for(worker):
    found = answer(worker, NextRise(DAILY - 1))
    assert (found.target, found.by) == (21.0, (MIDNIGHT + 6.5) * 3600.0)
    assert found == answer(worker, PreheatQuestion(21.0, found.by, 0.9, 0.5))
    assert answer(worker, NextRise(12)) is None, "there is none within six hours"
    assert answer(fed(fresh(), samples(3, PERIOD, told=False)), NextRise(DAILY - 1)) is None
    assert answer(by_day(worker), NextRise(DAILY - 1)) is None, "nobody knows how cold it will be after the set-back"


def test_the_room_is_warm_in_time_and_would_not_be_much_later(worker):
    by = MIDNIGHT + 6.5
    found = answer(worker, PreheatQuestion(21.0, by * 3600.0, 0.9, 0.5))
    start = found.start / 3600.0 - MIDNIGHT
    assert found.minutes == pytest.approx(60.0 * (6.5 - start))
    assert found.reached >= 0.9
    assert found.setpoint_before == 17.0
    place = int(6.5 * 2)
    warm, _ = followed(lambda hour: 21.0 if hour >= start else 17.0)
    assert warm[place] >= 20.4
    assert found.temperature.lower - 0.2 <= warm[place] <= found.temperature.upper + 0.2
    late, _ = followed(lambda hour: 21.0 if hour >= start + 1.5 else 17.0)
    assert late[place] < 20.4
    surer = answer(worker, PreheatQuestion(21.0, by * 3600.0, 0.99, 0.5))
    assert surer.start is None or surer.start <= found.start


@tabled
def test_a_time_of_day_is_the_next_one_also_where_the_clocks_are_put_back(text, start, expected):
    found = moment(text, datetime.fromisoformat(start).timestamp(), ZoneInfo("Europe/Berlin"))
    assert datetime.fromtimestamp(found, UTC).isoformat() == expected


def test_by_day_the_set_back_before_the_morning_is_foreseen(worker):
    question = PreheatQuestion(21.0, (MIDNIGHT + 6.5) * 3600.0, 0.9, 0.5)
    assert answer(by_day(worker), question) == answer(worker, question), "as if it were set back already"


def test_what_cannot_be_reached_is_said_with_the_probability_of_starting_now(worker):
    found = answer(worker, PreheatQuestion(24.0, (MIDNIGHT + 1.0) * 3600.0, 0.9, 0.5))
    assert found.start is None
    assert found.reached < 0.1
    assert b'"start":null' in document(found, "site", "room")


def relay():
    """8 kW that let the room swing 0.6 K and more to either side of its set-point."""
    on = False

    def power(excess):
        nonlocal on
        on = excess < 0.0 if abs(excess) > 0.6 else on
        return 8000.0 * on

    return power


def test_a_relay_that_lets_the_room_swing_is_no_reason_to_start_hours_earlier():
    period = PERIOD // 2
    worker = fed(fresh(period), samples(DAYS, period, power=relay()))
    by = MIDNIGHT + 6.5
    found = answer(worker, PreheatQuestion(21.0, by * 3600.0, 0.9, 0.5))
    assert found.reached >= 0.9

    def warm_once(start):
        wanted = lambda h: morning(h) if h < MIDNIGHT else 21.0 if h >= start else 17.0  # noqa: E731
        truth = recorded(DAYS + 1, period, wanted, relay())[0]
        return (truth[round((by - 2.0) * 4) : round(by * 4) + 1, 0] >= 20.5).any()

    latest = max(start for start in np.arange(MIDNIGHT, by, 0.25) if warm_once(start))
    assert latest - 0.75 <= found.start / 3600.0 <= latest


def test_demand_under_a_plan_is_what_the_house_then_takes(worker):
    before = worker.standing
    called = answer(worker, DemandQuestion(DAILY, USUAL))
    assert worker.standing is before
    assert answer(worker, DemandQuestion(DAILY, USUAL)).demand == called.demand
    _, heat = followed(morning)
    demand = called.demand
    assert demand.planned
    assert demand.total.lower <= kilowatt_hours(heat) <= demand.total.upper
    assert demand.total.mean == pytest.approx(kilowatt_hours(heat), rel=0.1)
    assert len(demand.hours) == 24
    assert sum(hour.energy.mean for hour in demand.hours) == pytest.approx(demand.total.mean)
    assert demand.hours[1].begin - demand.hours[0].begin == 3600.0
    # The set-point rises at half past six.
    assert max(demand.hours, key=lambda hour: hour.energy.mean).begin == (MIDNIGHT + 7) * 3600.0


def test_until_set_points_are_planned_they_are_the_likeliest(worker):
    late = Timed(np.array([(MIDNIGHT + 12.0) * 3600.0]), np.array([21.0]))
    told = np.where(np.arange(DAILY) < 24, USUAL, 21.0)
    assert answer(worker, DemandQuestion(DAILY, late)).demand == answer(worker, DemandQuestion(DAILY, told)).demand


def test_of_steps_longer_than_an_hour_each_has_its_energy():
    demand = answer(fed(fresh(4 * PERIOD), samples(DAYS, 4 * PERIOD)), DemandQuestion(DAILY // 4, None)).demand
    assert [one.begin for one in demand.hours] == [(MIDNIGHT + 2.0 * place) * 3600.0 for place in range(DAILY // 4)]
    assert sum(one.energy.mean for one in demand.hours) == pytest.approx(demand.total.mean)


def test_demand_without_a_plan_foresees_the_set_points(worker):
    called = answer(worker, DemandQuestion(DAILY, None))
    _, heat = followed(morning)
    assert not called.demand.planned
    assert called.demand.total.lower <= kilowatt_hours(heat) <= called.demand.total.upper


def test_the_difference_of_two_plans_is_surer_than_either(worker):
    found = answer(worker, CompareQuestion(DAILY, [Course("usual", USUAL), Course("1 K less", USUAL - 1.0)], 0.3))
    usual, less = found.plans
    (saved,) = found.differences
    truth = kilowatt_hours(followed(lambda hour: morning(hour) - 1.0)[1]) - kilowatt_hours(followed(morning)[1])
    assert saved.energy.lower <= truth <= saved.energy.upper
    assert saved.energy.mean == pytest.approx(less.energy.mean - usual.energy.mean)
    assert saved.energy.upper - saved.energy.lower < 0.8 * (usual.energy.upper - usual.energy.lower)
    assert saved.cost.mean == pytest.approx(0.3 * saved.energy.mean)
    assert saved.hours_below.mean > 4.0


def test_plans_that_are_alike_differ_in_nothing(worker):
    (difference,) = answer(worker, CompareQuestion(DAILY, [Course("a", 20.0), Course("b", 20.0)])).differences
    assert (difference.energy.lower, difference.energy.mean, difference.energy.upper) == (0.0, 0.0, 0.0)
    assert difference.cost is None


def test_zones_that_cannot_say_why():
    question = DemandQuestion(4, None)
    assert answer(fresh(), question) is None
    with pytest.raises(NoLaw, match=r"no law of the thermostat is known.*plan the heating in W"):
        answer(fed(fresh(), samples(1, PERIOD)), question)
    bare = new("ekf", replace(network("tite"), heat_inputs=()), PERIOD)
    with pytest.raises(NoLaw, match=r"no input of the zone is heat in W.*give it a channel u_heat"):
        answer(fed(bare, (Sample.measured(k * PERIOD, np.array([20.0]), np.array([5.0])) for k in range(9))), question)


def test_a_question_that_nobody_waits_for(worker):
    with pytest.raises(ServiceError, match="given up"):
        DemandQuestion(4, None)(worker, NO_WEATHER, lambda: True)


def test_errors_of_zones_add_up_as_independent_ones_do():
    one = Amounts(np.linspace(0.0, 10.0, 101)[:, None], np.full((101, 1), 1 / 101), np.full(101, -1))
    total = together([one] * 16)
    assert total.mean == pytest.approx(80.0)
    # A sum of 16 uniform ones has four times the sd of one of them; 4,000 draws leave some hundredths of it.
    assert total.upper - total.lower == pytest.approx(2 * 1.96 * 4 * 10.0 / np.sqrt(12.0), rel=0.06)
    assert together([]).mean == 0.0


def test_zones_have_the_same_weather():
    # Each kind of weather brings its own amount, and nothing else differs.
    weather = np.arange(610) % 61
    total = together([Amounts(weather[:, None] / 6.1, np.full((610, 1), 1 / 610), weather)] * 16)
    assert total.upper - total.lower == pytest.approx(16 * 0.95 * 10.0, rel=0.05)
