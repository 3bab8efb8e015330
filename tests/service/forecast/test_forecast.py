"""The engine behind every forecast: one zone, and rooms next door to each other."""

import numpy as np
import pytest
from support.forecasts import asked, fan_of, question
from support.site_of_rooms import PERIOD, Room, worker_of

from adapters.reading import Quality
from service.errors import NoModel, ServiceError
from service.forecast.coupling import Member, coupled
from service.forecast.engine import FixedRoom, Neighbour, Part
from service.forecast.foresight import NO_WEATHER
from service.forecast.request import FEWEST_DRAWS, MAX_STEPS, MOST_AT_ONCE, MOST_DRAW_STEPS, detail
from service.records.outlook import InputOrigin, Outlook
from service.records.record import values

ESTIMATORS = ("rbpf", "ekf", "ukf", "mkf", "bank", "arx", "daily")


@pytest.fixture(scope="module")
def workers():
    return {name: worker_of(Room(name)) for name in ESTIMATORS}


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_forecast_begins_with_the_published_one_and_asking_changes_nothing(workers, name):
    worker = workers[name]
    assert worker.latest is not None
    fans = [fan_of(worker, 12, {"u_heat": 500.0}, (0.95,)) for _ in range(2)]
    for fan in fans:
        (output,), (published,) = fan.outputs, worker.latest.forecast.outputs
        interval = published.intervals[0]
        first = (output.mean[0], output.median[0], output.sd[0], output.lower[0, 0], output.upper[0, 0])
        assert first == (published.mean, published.median, published.sd, interval.lower, interval.upper)
        assert output.mean.shape == (13,)
    for left, right in zip(*(values(fan.outputs[0]) for fan in fans if fan is not None), strict=True):
        np.testing.assert_array_equal(left, right)


def test_all_particles_count_as_long_as_there_is_room_for_them():
    day = 289
    for few in ([day], [day] * 11):
        assert detail(few).draws > 9000, "the particles of a zone by default"
    assert detail([day] * 50).draws == MOST_DRAW_STEPS // (50 * day)
    assert detail([MAX_STEPS + 1]) == (MOST_AT_ONCE // (MAX_STEPS + 1), True)
    assert detail([MAX_STEPS + 1] * 49) == (FEWEST_DRAWS, False)
    assert detail([]).exact


def test_fewer_draws_forecast_nearly_the_same(workers):
    """A tenth of the particles, at even steps of their weights: within five standard errors of independent draws."""
    worker = workers["rbpf"]
    few = question(36)._replace(detail=detail([36])._replace(draws=30))
    whole, part = fan_of(worker, 36), asked(worker, few)
    left, right = whole.outputs[0], part.outputs[0]
    assert np.abs(left.mean[1:] - right.mean[1:]).max() > 0.0
    assert (np.abs(left.mean - right.mean) < 5.0 * left.sd / np.sqrt(30)).all()


def test_a_forecast_that_nobody_waits_for_is_given_up(workers):
    with pytest.raises(ServiceError, match="nobody waits for it"):
        question(500)(workers["ekf"], NO_WEATHER, lambda: True)


def test_scenarios_of_a_model_without_physics_are_refused(workers):
    few = question(3)._replace(scenarios=5)
    with pytest.raises(NoModel, match="it knows no physics"):
        asked(workers["arx"], few)
    assert asked(workers["ekf"], few).outputs[0].scenarios.shape == (5, 4)


def test_what_a_neighbour_does_is_shifted_to_when_the_forecast_begins():
    worker = worker_of(Room("ekf", "ecolar-6r4c"))
    start = worker.latest.forecast.valid_time
    values = 20.0 + np.arange(6.0)
    origin = InputOrigin("T_adj", "neighbour", "next door", 0.0, Quality.GOOD)
    own = worker.latest.forecast.inputs[worker.network.inputs.index("T_adj")].value

    def means(first, told):
        fan = asked(worker, question(6)._replace(neighbours={"T_adj": Neighbour(first, told, origin)}))
        assert fan.origins[worker.network.inputs.index("T_adj")] == origin
        return np.asarray(fan.outputs[0].mean)

    # The neighbour was simulated two periods earlier, or this room is two periods behind.
    earlier = np.array([*values[2:], values[-1], values[-1]])
    later = np.array([own, own, *values[:4]])
    np.testing.assert_array_equal(means(start - 2 * PERIOD, values), means(start, earlier))
    np.testing.assert_array_equal(means(start + 2 * PERIOD, values), means(start, later))


class View:
    """A zone as far as `coupled` knows it."""

    def __init__(self, name, worker):
        self.id, self.network, self.period = name, worker.network, float(worker.period)


def test_a_room_that_is_behind_is_simulated_up_to_the_others_first():
    ahead, behind = worker_of(Room("ekf", "ecolar-6r4c", 40)), worker_of(Room("ekf", "ecolar-6r4c", 38))
    members = []
    for name, other, worker, first in (("a", "b", ahead, 10.0), ("b", "a", behind, 30.0)):
        assert worker.latest is not None
        room = FixedRoom(first + np.arange(7.0)[:, None])
        part = Part(worker.latest, Outlook(np.zeros((6, len(worker.network.inputs))), ()), room)
        members.append(Member(View(name, worker), part, {"T_adj": (other, "T_air")}))  # type: ignore[arg-type]
    found = coupled(members)
    start = members[0].start
    assert {told["T_adj"].start for told in found.values()} == {start}
    assert start == members[1].start + 2 * PERIOD
    assert found["a"]["T_adj"].values.tolist() == [32.0, 33.0, 34.0, 35.0, 36.0, 36.0]
    assert found["b"]["T_adj"].values.tolist() == [10.0, 11.0, 12.0, 13.0, 14.0, 15.0]
    assert found["b"]["T_adj"].origin == InputOrigin("T_adj", "neighbour", "a", 0.0, Quality.GOOD)
    assert found["a"]["T_adj"].origin.age == 2 * PERIOD
    # One that is far behind is left out, and so is one of another period.
    assert coupled([members[0], members[1]._replace(part=members[1].part._replace(update=old(members[1])))]) == {}


def old(member):
    """The update of `member`, 13 periods earlier."""
    update, back = member.part.update, 13 * PERIOD
    forecast = update.forecast
    return update._replace(forecast=forecast._replace(valid_time=forecast.valid_time - back))
