"""The bank: weights by horizon, coverage by feedback, members that fail, networks that differ, its state as arrays."""

from typing import NamedTuple

import numpy as np
import pytest
from support.forecasts import unfolded
from support.small_building import two_rooms

from estimator.bank.bank import Bank, answering_plan, by_physics
from estimator.bank.options import BankOptions, Member
from estimator.errors import OptionsError
from estimator.heat.terms import with_known_heat
from estimator.kernels.draws import Draws
from estimator.network.presets import automatic, network
from estimator.registry import build
from estimator.types import Mixture, Mixtures, Outcome, Posterior

PERIOD = 1800.0
NETWORK = network("tite")
NOISE = 0.3
SMALL = {
    "jump": {"estimator": "mkf", "particles": 40},
    "free": {"estimator": "mkf", "preset": "free", "particles": 24},
    "rbpf": {"estimator": "rbpf", "particles": 60},
    "arx": {"estimator": "arx"},
    "daily": {"estimator": "daily"},
}


class SomeState(NamedTuple):
    restarts: np.ndarray


class SomeForecaster:
    """Always 20 degC and a bias of its own, one for the next sample and one for later ones, which are warmer by what is
    heated above 300 W; it learns nothing."""

    physical = True
    verifies_itself = False
    blocks = ()
    issue_type = SomeState

    def __init__(self, bias, later_bias, sd, deaf=False, per_watt=0.0):
        self.network, self.bias, self.later_bias, self.sd, self.deaf = NETWORK, bias, later_bias, sd, deaf
        self.per_watt = per_watt

    def start(self, seed, outputs, inputs):
        return SomeState(np.array(0))

    def restart(self, state, outputs, inputs):
        return SomeState(state.restarts + 1)

    def predict(self, state, inputs):
        return state

    def predictive(self, state):
        return Mixture(np.ones(1), np.array([[20.0 + self.bias]]), np.array([[self.sd]]))

    def update(self, state, outputs):
        outcome = Outcome.VANISHED if self.deaf else Outcome.ASSIMILATED
        return Posterior(state, outcome, np.nan if self.deaf else 0.0, np.ones(len(NETWORK.parameters)))

    def issue(self, state, count):
        return state

    def unfold(self, issue, plan):
        means = 20.0 + self.later_bias + self.per_watt * (np.pad(plan[:, 1:], ((1, 0), (0, 0))) - 300.0)
        means[0] = 20.0 + self.bias
        return Mixtures.of_gaussians(means, np.full_like(means, self.sd))

    def verified(self, state, lead, errors):
        return state

    def pack(self, state):
        return state._asdict()


def bank_of(members, period=PERIOD, without_plans=(), **options):
    named = {name: Member("mkf", NETWORK, None, plans=name not in without_plans) for name in members}
    return Bank(NETWORK, period, BankOptions(members=named, voice=next(iter(members)), **options), members)


def samples(count, seed=3):
    return 20.0 + NOISE * np.random.default_rng(seed).standard_normal(count)


def played(bank, outputs, state=None):
    """The state after `outputs`, all posteriors, and whether each sample was in the interval published for it."""
    inputs = np.array([5.0, 300.0])
    state = bank.start(1, np.array([20.0]), inputs) if state is None else state
    posteriors, covered = [], []
    for y in outputs:
        state = bank.predict(state, inputs)
        lower, upper = bank.predictive(state).quantiles(np.array([0.025, 0.975]), 0)
        covered.append(lower <= y <= upper)
        posteriors.append(bank.update(state, np.array([y])))
        state = posteriors[-1].state
    return state, posteriors, np.array(covered)


def test_every_horizon_trusts_who_is_good_at_it():
    members = {"sprinter": SomeForecaster(0.0, 1.0, NOISE), "stayer": SomeForecaster(1.0, 0.0, NOISE)}
    for member in members.values():
        # Who answers plans would be corrected.
        member.physical = False
    bank = bank_of(members)
    state, _, _ = played(bank, samples(600))
    weights = bank.member_weights(state)
    assert weights["sprinter"][0] > 0.9
    assert (weights["stayer"][1:] > 0.9).all()
    np.testing.assert_allclose(weights["sprinter"] + weights["stayer"], 1.0)
    fan = unfolded(bank, state, np.tile([5.0, 300.0], (48, 1)))
    assert abs(fan[0].mean()[0] - 20.0) < 0.15
    assert abs(fan[-1].mean()[0] - 20.0) < 0.15


def test_what_a_bank_verifies_is_what_it_had_published():
    bank = bank_of({"cold": SomeForecaster(-0.5, -0.5, NOISE), "warm": SomeForecaster(0.1, 0.1, NOISE)})
    inputs, lead = np.array([5.0, 300.0]), bank.leads[2]
    state, told, held = bank.start(1, np.array([20.0]), inputs), [], 0
    for y in samples(4 * lead):
        state = bank.predict(state, inputs)
        told.append(unfolded(bank, state, np.tile(inputs, (lead - 1, 1)))[-1])
        posterior = bank.update(state, np.array([y]))
        state = posterior.state
        for one in posterior.verified:
            if one.lead == lead:
                then = told[-lead]
                assert one.mixture.mean()[0] == pytest.approx(then.mean()[0], abs=1e-9)
                assert one.mixture.sd()[0] == pytest.approx(then.sd()[0], abs=1e-9)
                held += 1
    assert held > lead / 2
    assert abs(told[-1].mean()[0] - told[0].mean()[0]) > 0.1, "it has learned whom to trust meanwhile"


def test_what_is_learned_of_an_hour_counts_for_the_hours_after_it():
    members = {"poor": SomeForecaster(0.4, 0.4, NOISE), "good": SomeForecaster(0.0, 0.0, NOISE)}
    for sharing, most in ((0.0, 0.51), (0.5, 1.0)):
        bank = bank_of(members, sharing=sharing)
        state, _, _ = played(bank, samples(bank.leads[-1] - 2))
        day_ahead = bank.member_weights(state)["good"][-1]
        assert day_ahead <= most
        assert (day_ahead > 0.6) == (sharing > 0.0), "no forecast of a whole day has come true yet"


@pytest.mark.parametrize("factor", [1 / 3, 3.0])
def test_the_published_interval_covers_what_it_claims_though_the_members_do_not(factor):
    bank = bank_of({"only": SomeForecaster(0.0, 0.0, factor * NOISE)})
    _state, posteriors, covered = played(bank, samples(3000))
    # Four standard errors of 2,500 draws, and as much again for the scale, which never comes to rest.
    assert abs(covered[500:].mean() - 0.95) < 8 * np.sqrt(0.95 * 0.05 / 2500)
    later = [(one.lead, one.mixture.sd()[0]) for posterior in posteriors[-300:] for one in posterior.verified]
    for lead in bank.leads[1:]:
        sds = [sd for own, sd in later if own == lead]
        assert sds
        assert NOISE / 1.6 < np.mean(sds) < 1.6 * NOISE


def test_a_member_that_explains_nothing_is_left_out_and_started_anew():
    members = {"good": SomeForecaster(0.0, 0.0, NOISE), "deaf": SomeForecaster(5.0, 5.0, NOISE, deaf=True)}
    bank = bank_of(members)
    state, posteriors, _ = played(bank, samples(5))
    assert posteriors[-1].outcome is Outcome.ASSIMILATED
    assert bank.member_weights(state)["deaf"].max() < 1e-9
    assert state.members[1].restarts == 0
    state, _, _ = played(bank, samples(20), state)
    assert state.members[1].restarts >= 2
    assert state.members[0].restarts == 0
    assert abs(bank.predictive(state).mean()[0] - 20.0) < 0.1


def test_a_sample_without_a_measurement_brings_no_lost_member_back():
    members = {"good": SomeForecaster(0.0, 0.0, NOISE), "deaf": SomeForecaster(5.0, 5.0, NOISE, deaf=True)}
    bank = bank_of(members)
    outputs = samples(22)
    outputs[1::2] = np.nan
    state, _, _ = played(bank, outputs[:4])
    assert bank.member_weights(state)["deaf"].max() < 1e-9
    state, _, _ = played(bank, outputs[4:], state)
    assert state.members[1].restarts == 1


@pytest.mark.parametrize("minutes", [10, 30, 45, 120, 360])
def test_forecasts_hours_ahead_stand_for_the_time_between_two_of_them(minutes):
    bank = bank_of({"one": SomeForecaster(0.0, 0.0, NOISE)}, period=60.0 * minutes, discount=1.0)
    state, _, _ = played(bank, samples(8 * 24 * 60 // minutes))
    np.testing.assert_allclose(state.costs.hours, 8 * 24.0 - np.array(bank.leads) * minutes / 60.0, atol=12.0)


def test_a_member_is_not_told_how_far_it_was_from_a_sample_that_it_refused():
    bank = bank_of({"good": SomeForecaster(0.0, 0.0, NOISE), "arx": build("arx", NETWORK, PERIOD, {})})
    outputs = samples(200)
    outputs[[150, 153]] = 60.0
    state, posteriors, _ = played(bank, outputs)
    assert posteriors[150].outcome is Outcome.ASSIMILATED
    squares, counts = state.members[1].errors[: len(bank.leads) - 1, 0].T
    assert (counts > 50.0).all()
    assert (squares / counts < 1.0).all()


def test_a_member_that_is_lost_before_the_first_forecast_is_issued_is_started_anew():
    members = {"good": SomeForecaster(0.0, 0.0, NOISE), "deaf": SomeForecaster(5.0, 5.0, NOISE, deaf=True)}
    bank = bank_of(members, period=60.0)
    state, _, _ = played(bank, samples(20), bank.start(0, np.array([20.0]), np.array([5.0, 300.0])))
    assert not state.pending.issues
    assert state.members[1].restarts == 3
    # State of an earlier version knows no inputs then: the member waits for the next sample.
    before = state._replace(pending=state.pending._replace(inputs=np.empty((0, 2))), lost=np.array([0.0, 5.0]))
    after = bank.update(before, np.array([20.0])).state
    assert (after.members[1].restarts, after.lost[1]) == (3, 6.0)
    assert bank.update(bank.predict(after, np.array([5.0, 300.0])), np.array([20.0])).state.members[1].restarts == 4


def test_what_a_plan_of_heating_changes_is_told_by_members_with_physics_that_are_fit_for_it():
    known = {"physical": (1.0, 0.01), "regression": (-1.0, 0.05), "output-error": (-2.0, 0.0)}
    members = {name: SomeForecaster(0.0, bias, NOISE, per_watt=warms) for name, (bias, warms) in known.items()}
    members["regression"].physical = False
    bank = bank_of(members, without_plans=["output-error"])

    def after(asked, heat):
        return bank.unfold(asked, np.tile([5.0, heat], (48, 1))).moments()[0][-1, 0]

    # From a start on which the members agree, so that nobody is held back by the middle.
    state, _, _ = played(bank, samples(60))
    state = state._replace(costs=state.costs._replace(hours=np.full(len(bank.leads), 1e6)))
    asked, physics = answering_plan(bank, state), by_physics(bank, state)
    assert after(asked, 900.0) - after(asked, 300.0) == pytest.approx(6.0)
    assert abs(after(asked, 300.0) - 20.0) < 0.5, "all know what is usual"
    adrift = asked._replace(lost=np.array([3.0, 0.0, 0.0]))
    assert after(adrift, 900.0) - after(adrift, 300.0) == pytest.approx(6.0), "who else would know"
    assert after(physics, 900.0) == pytest.approx(27.0)
    assert state.lost.sum() == 0.0, "asking changes nothing"
    alone = members["physical"].start(1, np.array([20.0]), np.zeros(2))
    assert answering_plan(members["physical"], alone) is by_physics(members["physical"], alone) is alone
    # Somebody has to answer.
    bank = bank_of({name: members[name] for name in ("regression", "output-error")}, without_plans=["output-error"])
    state, _, _ = played(bank, samples(60))
    asked = answering_plan(bank, state)
    assert after(asked, 900.0) == pytest.approx(after(asked, 300.0))


def test_what_another_heating_would_do_is_right_although_a_thermostat_made_the_records():
    """Two rooms keep the same hours, and windows that nobody measures make the thermostat heat more."""
    rng, period, days = np.random.default_rng(1), 900.0, 10
    network = automatic(("T_i", "T_out", "u_heat", "T_adj_next"))
    members = {name: {"estimator": "mkf", "preset": name} for name in ("habits-slow", "habits")}
    members["habits-slow"]["plans"] = False
    bank = build("bank", network, period, {"members": members})

    def moved(air, wall, heat, outdoor, beside, window):
        to_wall = 280.0 * (air - wall)
        gained = heat - to_wall + 25.0 * (beside - air) - window * (air - outdoor)
        return air + period / 1.2e6 * gained, wall + period / 1e7 * (to_wall - 50.0 * (wall - outdoor))

    air, wall, beside, integral, state = 20.0, 18.0, 20.0, 300.0, None
    windows = 40.0 * (rng.random((2, days, 24)) < 0.2)
    for k in range(96 * days):
        hour, outdoor = k / 4 % 24, 3.0 + 4.0 * np.sin(k / 70.0)
        wanted = 21.0 if 6 <= hour < 22 else 18.0
        window, window_beside = windows[:, k // 96, int(hour)]
        integral = np.clip(integral + 60.0 * (wanted - air), 0.0, 1500.0)
        heat = np.clip(900.0 * (wanted - air) + integral, 0.0, 1800.0)
        row, measured = np.array([outdoor, beside, heat]), np.array([air + 0.03 * rng.standard_normal()])
        state = bank.start(1, measured, row) if state is None else bank.update(state, measured).state
        state = bank.predict(state, row)
        air, wall = moved(air, wall, heat, outdoor, beside, window)
        beside += period / 3600.0 * (wanted - 0.02 * window_beside - beside)

    def response(forecast):
        return forecast(1800.0) - forecast(0.0)

    def truth(heat):
        room = air, wall
        for _ in range(12):
            room = moved(*room, heat, 3.0, 18.0, 0.0)
        return room[0]

    def foreseen(asked):
        plan = np.tile([3.0, 18.0, 0.0], (12, 1))
        return lambda heat: bank.unfold(asked, plan + np.array([0.0, 0.0, heat])).moments()[0][-1, 0]

    told = response(foreseen(answering_plan(bank, state)))
    assert told == pytest.approx(response(truth), rel=0.2)
    only = bank.plans.copy()
    bank.plans = ~only
    assert response(foreseen(answering_plan(bank, state))) < 0.5 * told


def test_a_wild_member_does_not_spoil_the_first_forecasts_and_is_heard_once_it_has_proved_itself():
    members = {name: SomeForecaster(0.0, later, NOISE) for name, later in (("a", 0.0), ("b", 0.1), ("wild", 9.0))}
    bank = bank_of(members)
    plan = np.tile([5.0, 300.0], (47, 1))
    first = bank.predict(bank.start(1, np.array([20.0]), plan[0]), plan[0])
    assert abs(bank.unfold(first, plan).moments()[0][-1, 0] - 20.1) < NOISE
    state = first
    for k in range(600):
        y = 29.0 if k > 100 else 20.0
        state = bank.predict(bank.update(state, np.array([y])).state, plan[0])
    assert abs(bank.unfold(state, plan).moments()[0][-1, 0] - 29.0) < 0.5


def test_pending_forecasts_from_before_members_were_held_together_come_true():
    bank = small_bank()
    arrays = bank.pack(walked(bank, started(bank), 0, 60))
    arrays["pending.note"] = arrays["pending.note"][:, :-1]
    back = bank.unpack(arrays)
    assert all(np.isinf(issue.note[-1]).all() for issue in back.pending.issues)
    told = []
    for _ in range(2):
        posterior = bank.update(bank.predict(back, np.array([5.0, 0.0])), np.array([20.0]))
        back, told = posterior.state, [*told, *posterior.verified]
    assert told
    assert all(np.isfinite(one.mixture.mean()).all() for one in told)


def test_members_that_answer_plans_may_change_under_stored_state():
    members = [SMALL | {"free": SMALL["free"] | {"plans": plans}} for plans in (True, False)]
    bank, other = (build("bank", NETWORK, PERIOD, {"members": each}) for each in members)
    state = other.unpack(bank.pack(walked(bank, started(bank), 0, 60)))
    assert walked(other, state, 60, 70).residuals.members.tolist() == [0, 2]


def test_what_nobody_can_explain_changes_nothing_that_was_learned():
    bank = bank_of({"a": SomeForecaster(0.0, 0.0, NOISE, deaf=True), "b": SomeForecaster(0.0, 0.0, NOISE, deaf=True)})
    state, posteriors, _ = played(bank, samples(3))
    assert posteriors[-1].outcome is Outcome.VANISHED
    assert not state.costs.hours.any()
    assert not state.widths.verified.any()


def small_bank(net=NETWORK, **options):
    return build("bank", net, PERIOD, {"members": SMALL} | options)


def walked(bank, state, first, count, outputs=1):
    """Predicted and updated with made-up samples `first` to `first + count`."""
    for k in range(first, first + count):
        rng = np.random.default_rng(k)
        inputs = np.array([5.0 + np.sin(k / 8)] + [600.0 * (rng.random() < 0.5)] * (len(bank.network.inputs) - 1))
        state = bank.update(bank.predict(state, inputs), 20.0 + 0.1 * rng.standard_normal(outputs)).state
    return state


def started(bank, outputs=1):
    return bank.start(1, np.full(outputs, 20.0), np.array([5.0] + [0.0] * (len(bank.network.inputs) - 1)))


def test_a_day_without_measurements_is_survived():
    bank = small_bank()
    state = walked(bank, started(bank), 0, 30)
    learned = state.costs
    for _ in range(48):
        posterior = bank.update(bank.predict(state, np.array([5.0, 0.0])), np.array([np.nan]))
        state = posterior.state
        assert posterior.outcome is Outcome.MISSING
        assert posterior.verified == ()
    assert np.array_equal(state.costs.excess, learned.excess)
    state = walked(bank, state, 30, 20)
    assert np.isfinite(bank.predictive(state).sd()).all()
    assert np.isfinite(bank.pack(state)["costs.excess"]).all()


def test_several_outputs_are_published_and_learned_from():
    bank = small_bank(two_rooms())
    state = walked(bank, started(bank, 2), 0, 60, outputs=2)
    half = bank.update(bank.predict(state, np.array([5.0, 0.0, 0.0])), np.array([np.nan, 20.0]))
    assert half.outcome is Outcome.ASSIMILATED
    for mixture in unfolded(bank, half.state, np.tile([5.0, 0.0, 0.0], (10, 1))):
        assert mixture.means.shape[0] == 2
        for output in (0, 1):
            lower, upper = mixture.quantiles(np.array([0.025, 0.975]), output)
            assert lower < mixture.mean()[output] < upper
    assert state.costs.hours[0] == pytest.approx(60 * PERIOD / 3600, rel=0.1)


def test_members_may_differ_in_their_network():
    members = SMALL | {"ground": {"estimator": "mkf", "preset": "free", "particles": 24, "network": "ground"}}
    bank = small_bank(members=members)
    assert len(bank.members[-1].network.nodes) == 3
    state = walked(bank, started(bank), 0, 30)
    posterior = bank.update(bank.predict(state, np.array([5.0, 0.0])), np.array([20.0]))
    summary = bank.parameters(posterior.state, np.array([0.1, 0.9]))
    assert posterior.parameters.shape == (len(NETWORK.parameters),)
    assert summary.parameters.shape == (len(NETWORK.parameters), 2)
    assert summary.time_constants.shape == (2, 2)
    assert np.isfinite(bank.predictive(posterior.state).sd()).all()
    with pytest.raises(OptionsError, match=r"members.ground.network = 'moon' must be one of own, ground"):
        small_bank(members={"ground": {"estimator": "mkf", "network": "moon"}})


def test_parameters_are_uncertain_where_the_members_disagree():
    bank = small_bank()
    state = walked(bank, started(bank), 0, 40)
    ends = np.array([0.001, 0.5, 0.999])
    weights = np.array(list(bank.member_weights(state).values()))[:, 2]
    physical = [place for place, member in enumerate(bank.members) if member.physical and weights[place] >= 0.1]
    assert len(physical) > 1
    own = [bank.members[place].parameters(state.members[place], ends) for place in physical]
    mixture = bank.parameters(state, ends)
    for row, median in enumerate(mixture.parameters[:, 1]):
        medians = [summary.parameters[row, 1] for summary in own]
        assert min(medians) * 0.8 <= median <= max(medians) * 1.25
    assert mixture.heat_loss[0] <= 1.1 * min(summary.heat_loss[1] for summary in own)
    assert mixture.heat_loss[2] >= 0.9 * max(summary.heat_loss[1] for summary in own)
    blind = small_bank(members={"arx": {"estimator": "arx"}})
    assert not blind.physical
    assert np.isnan(blind.parameters(walked(blind, started(blind), 0, 5), ends).heat_loss).all()


def test_a_fan_is_the_weighted_mixture_of_the_members_fans():
    bank = small_bank()
    state = walked(bank, started(bank), 0, 40)
    plan = np.tile([4.0, 300.0], (12, 1))
    fan = unfolded(bank, state, plan)
    assert len(fan) == 13
    weights = np.array(list(bank.member_weights(state).values()))
    parts = [
        list(member.unfold(member.issue(own, bank.options.scenarios), plan).each())
        for member, own in zip(bank.members, state.members, strict=True)
    ]
    horizon = bank.leads.index(12)
    means = np.array([part[11].mean()[0] for part in parts])
    assert fan[11].mean()[0] == pytest.approx(float(weights[:, horizon] @ means), rel=1e-9)
    spread = np.array([part[11].sd()[0] ** 2 for part in parts]) + means**2
    sd = np.sqrt(float(weights[:, horizon] @ spread) - float(weights[:, horizon] @ means) ** 2)
    assert fan[11].sd()[0] == pytest.approx(sd * np.exp(state.widths.log_scale[horizon]), rel=1e-6)


def test_no_forecast_leaves_what_the_room_can_do_but_under_a_plan_of_heat():
    arx = build("arx", NETWORK, PERIOD, {})
    bank = bank_of({"wild": SomeForecaster(0.0, 40.0, NOISE, per_watt=0.1), "arx": arx})
    state, posteriors, _ = played(bank, samples(100))
    low, high = arx.bounds(state.members[1])[0]
    assert 16.0 < low < 19.0
    assert 21.0 < high < 24.0
    plan = np.tile([5.0, 300.0], (48, 1))
    assert max(one.mean()[0] for one in unfolded(bank, state, plan)) <= high
    verified = [one.mixture.mean()[0] for posterior in posteriors for one in posterior.verified]
    assert len(verified) > 100
    assert max(verified) <= high
    assert unfolded(bank, answering_plan(bank, state), 2.0 * plan)[-1].mean()[0] > high + 20.0


@pytest.mark.parametrize("prior", [0, [1, 1], [1, 1, 1, -1], "much", [1, 1, 1, True]])
def test_a_prior_is_positive_numbers(prior):
    with pytest.raises(OptionsError, match=r"members.arx.prior must be a number above 0, or a list of 4"):
        small_bank(members={"arx": {"estimator": "arx", "prior": prior}})


def test_options_of_a_member_name_the_member():
    with pytest.raises(OptionsError, match=r"members.arx: .*past_outputs"):
        small_bank(members={"arx": {"estimator": "arx", "past_outputs": 0}})
    with pytest.raises(OptionsError, match="a bank cannot be a member of a bank"):
        small_bank(members={"inner": {"estimator": "bank"}})
    with pytest.raises(OptionsError, match="voice = 'nobody' must be one of the members"):
        small_bank(voice="nobody")
    with pytest.raises(OptionsError, match=r"voice = \['rbpf'\] must be one of the members"):
        small_bank(voice=["rbpf"])
    with pytest.raises(OptionsError, match=r"members.a.network = \['own'\] must be one of"):
        small_bank(members={"a": {"estimator": "mkf", "network": ["own"]}})


def test_sun_and_habits_are_told_whatever_the_member_weighs_that_knows_them():
    known = with_known_heat(automatic(("T_i", "T_out", "u_heat")), habits=True)
    knowing = {"estimator": "mkf", "preset": "habits-slow", "prior": 1e-6}
    members = {"knowing": knowing, "ekf": {"estimator": "ekf", "network": "bare"}}
    bank = build("bank", known, PERIOD, {"members": members})
    drive = np.array([5.0, 1000.0, *np.ones(16)])
    state = bank.predict(bank.start(1, np.array([20.0]), drive), drive)
    summary = bank.parameters(state, np.array([0.025, 0.5, 0.975]))
    assert summary.coefficients.shape == (16, 3)
    assert 100.0 < summary.coefficients[0, 1] < 300.0
    # And of the building for the most part, unless it cannot explain the samples.
    shares = np.array([each.weights.sum() for each in bank._drawn(state)])
    np.testing.assert_allclose(shares / shares.sum(), [0.6, 0.4])
    learned = bank.update(state, np.array([20.1]))
    alone = bank.members[0].update(state.members[0], np.array([20.1]))
    np.testing.assert_array_equal(learned.parameters, alone.parameters)
    assert bank.draws(state, 8).member == "knowing"
    lost = state._replace(lost=np.array([1.0, 0.0]))
    shares = np.array([each.weights.sum() for each in bank._drawn(lost)])
    assert shares[0] / shares.sum() < 1e-6


def test_unmeasured_heat_is_told_with_that_of_habits_by_a_member_that_plans_names():
    """By the draws of its own Gaussians; noise of the sensor by the first member."""
    known = with_known_heat(automatic(("T_i", "T_out", "u_heat")), habits=True)
    members = {
        "jump": {"estimator": "mkf", "network": "bare", "plans": False},
        "habits-slow": {"estimator": "mkf", "preset": "habits-slow", "plans": False},
        "habits": {"estimator": "mkf", "preset": "habits"},
    }
    bank, rng = build("bank", known, PERIOD, {"members": members}), np.random.default_rng(4)
    state = bank.start(1, np.array([20.0]), np.array([5.0, 1000.0, *np.zeros(16)]))
    for k in range(60):
        habits = np.roll([0.5, 0.5, *np.zeros(14)], k // 10)
        drive = np.array([5.0, 1000.0, *habits])
        state = bank.predict(state, drive)
        posterior = bank.update(state, 20.0 + 0.3 * rng.standard_normal(1))
        state = posterior.state
    told = posterior.disturbance(drive)
    _, _, own = state.members
    draws = bank.members[2]._sample(own, Draws(3, 4), 20_000)[1]
    model = bank.members[2]._model
    heat = 1000.0 * draws[model.states] + habits @ draws[model.coefficients]
    expected = np.quantile(heat, [0.025, 0.5, 0.975])
    np.testing.assert_allclose(told.gain, expected, atol=0.04 * (expected[2] - expected[0]))
    assert not np.allclose(told.gain, posterior.disturbance(np.zeros(18)).gain, atol=20.0), "of the hour"
    assert told.measurement_sd[0, 0] < told.measurement_sd[0, 2], "the first member learns it"
    # A member that answers plans itself tells its own heat.
    members["jump"]["plans"] = True
    own = build("bank", known, PERIOD, {"members": members}).update(bank.predict(state, drive), np.array([20.0]))
    assert own.disturbance(drive).gain == pytest.approx(own.disturbance(np.zeros(18)).gain)
