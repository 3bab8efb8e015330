"""A room that reads one heat meter with others: what it answers is in its own watts, with the share it has learned."""

import numpy as np
import pytest
from support.forecasts import asked, fan_of
from support.thermostat_house import morning, recorded, samples
from support.zone_samples import fed, worker

from estimator.network.presets import network
from service.forecast import room
from service.forecast.heating import DemandQuestion
from service.forecast.learned import ModelQuestion, learned_laws
from service.forecast.room import Past, RoomQuestion
from service.forecast.shares import Shares

PERIOD, DAILY, DAYS = 1800, 48, 8
METERED = 4.0
"""What the meter shows for each watt of the room: three other rooms are heated alike."""

USUAL = np.array([morning(24.0 * DAYS + step / 2) for step in range(DAILY)])


SHARED = network("tite").with_share("u_heat", 1.0 / METERED)


@pytest.fixture(scope="module")
def alone():
    return fed(worker("ekf", "tite", PERIOD), samples(DAYS, PERIOD))


@pytest.fixture(scope="module")
def sharing():
    return fed(worker("ekf", SHARED, PERIOD), samples(DAYS, PERIOD, metered=METERED))


def test_the_share_is_learned_with_an_interval(sharing):
    learned = Shares.of(sharing)
    lower, median, upper = sharing.parameters((0.025, 0.5, 0.975)).parameters[sharing.network.shares["u_heat"]]
    assert lower < 1.0 / METERED < upper
    assert learned.medians.tolist() == [1.0, median]
    assert learned.spreads[0] == 0.0 < learned.spreads[1]
    sampled = learned.sampled(np.array([1, 0]), 999)
    assert np.quantile(sampled[:, 0], [0.025, 0.5, 0.975]) == pytest.approx([lower, median, upper], rel=0.1)
    assert (sampled[:, 1] == 1.0).all()


def test_set_points_are_planned_as_with_a_meter_of_its_own(alone, sharing):
    own, shared = (fan_of(worker, DAILY, {"T_set": USUAL}).outputs[0] for worker in (alone, sharing))
    assert np.sqrt(np.mean((shared.mean - own.mean) ** 2)) < 0.15


def test_energy_and_power_are_those_of_the_room(alone, sharing):
    own, shared = (asked(worker, DemandQuestion(DAILY, USUAL)).demand.total for worker in (alone, sharing))
    learned = Shares.of(sharing)
    share, mean = float(learned.medians[1]), float(learned.sampled(np.array([1]), 200).mean())
    assert shared.mean == pytest.approx(own.mean * METERED * mean, rel=0.1)
    assert shared.lower < own.mean < shared.upper
    assert shared.upper / shared.lower > 2.0 * own.upper / own.lower, "what is not known of the share adds to it"
    (law,), (other,) = learned_laws(alone), learned_laws(sharing)
    assert other.power.mean == pytest.approx(law.power.mean * METERED * share, rel=0.05)
    assert other.power.lower < law.power.mean < other.power.upper
    assert (other.offset.mean, other.band.mean) == pytest.approx((law.offset.mean, law.band.mean), abs=0.05)


def test_watts_are_planned_and_modelled_as_those_of_the_room(sharing):
    share = float(Shares.of(sharing).medians[1])
    cold, warm = (fan_of(sharing, 12, {"u_heat": watts}).outputs[0].mean for watts in (0.0, 3000.0))
    row = np.array([sharing.carried.held.values[0], 3000.0 / share])
    state = sharing.standing.state
    plan = np.tile(row, (12, 1))
    told = sharing.estimator.unfold(sharing.estimator.issue(state, 1), plan).moments()[0][:, 0]
    assert warm[-1] > cold[-1] + 0.5
    # The weather follows yesterday's, which a plan of one row does not.
    assert warm[1:] - cold[1:] == pytest.approx(
        told[1:] - sharing.estimator.unfold(sharing.estimator.issue(state, 1), plan * [1.0, 0.0]).moments()[0][1:, 0]
    )
    model = asked(sharing, ModelQuestion(1, 4, "ekf"))
    of_meter = sharing.estimator.draws(state, 4)
    # A watt warms the air by its capacitance alone.
    assert model.draws.B[:, 0, 1] == pytest.approx((PERIOD / of_meter.theta[0]), rel=0.2)


def test_what_the_room_used_is_its_share_with_an_interval(alone, sharing):
    outputs, inputs, setpoint = (np.array(each) for each in recorded(DAYS, PERIOD))
    past = Past(PERIOD * np.arange(float(len(inputs))), PERIOD, outputs[:, 0], setpoint, np.zeros((len(inputs), 3)),
                inputs * [1.0, METERED])  # fmt: skip
    (own,), (shared,) = (
        [one for one in asked(worker, RoomQuestion(told)).answers if one.about == "energy"]
        for worker, told in ((alone, past._replace(inputs=inputs)), (sharing, past))
    )
    assert np.isnan(own.lower)
    assert "95 %" not in own.sentence
    assert shared.value == pytest.approx(own.value * METERED * Shares.of(sharing).medians[1])
    assert shared.lower < own.value < shared.upper
    assert f"95 % between {shared.lower:.3g} and {shared.upper:.3g} kWh" in shared.sentence


def test_what_departed_from_usual_is_told_in_watts_of_the_room(sharing, monkeypatch):
    told = []
    monkeypatch.setattr(room, "last_day", lambda worker, times, step, inputs, gain: told.append(inputs) or ())
    metered = np.tile([5.0, 6000.0], (DAILY, 1))
    past = Past(PERIOD * np.arange(float(DAILY)), PERIOD, *np.full((2, DAILY), 20.0), np.zeros((DAILY, 3)), metered)
    asked(sharing, RoomQuestion(past))
    assert told[0] == pytest.approx(metered * Shares.of(sharing).medians)


def test_an_estimator_that_knows_no_building_has_the_likely_share():
    regression = fed(worker("arx", SHARED, PERIOD), samples(DAYS, PERIOD, metered=METERED))
    (law,) = learned_laws(regression)
    assert Shares.of(regression).medians.tolist() == [1.0, 1.0 / METERED]
    assert law.power.mean == pytest.approx(6000.0, rel=0.02)
