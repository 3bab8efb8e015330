"""Trust: lost at once, won back by hours of better forecasts, and said with a reason."""

from dataclasses import replace

import pytest
from support.fake_zones import make_update, skill_over
from support.tables import tabled

from estimator.diagnosis.finding import Diagnosis, Finding
from service.records.skill import HorizonSkill, IssuedSkill
from service.records.stored import named, stored
from service.records.trust import Trust, untrusted
from service.records.update import Gate
from service.zone.trust import RISES, judged

GOOD = {"coverage": 0.95, "rmse": 0.4, "persistence_rmse": 0.8, "forecasts": 100}


def horizon(lead, **given):
    numbers = GOOD | given
    return HorizonSkill.of(
        lead, numbers["forecasts"], numbers["coverage"], 0.2, numbers["rmse"], 0.2, numbers["persistence_rmse"], 0.5
    )


def skill(day=None, issued=None, **week):
    """Two horizons, of which the second is as `week` says, and in the last day as `day` says beside that."""
    weeks = (horizon(300), horizon(21600, **week))
    days = (horizon(300), horizon(21600, **(week | {"forecasts": 24} | (day or {}))))
    return skill_over(0, {1: days, 7: weeks, 30: weeks}, issued)


def as_issued(week, day=None, forecasts=100, of_day=24, **known):
    """The skill of forecasts that are good in hindsight, and cover as `week` and `day` say as they were issued."""
    rest = [0.2] * 7
    weeks = (IssuedSkill(21600, forecasts, week, *rest),)
    days = (IssuedSkill(21600, of_day, week if day is None else day, *rest),)
    return skill(issued={1: days, 7: weeks, 30: weeks}, **known)


def after(trust, found, hours=1, findings=(), update=None):
    diagnosis = Diagnosis(tuple(Finding(name, "zone", f"{name}; do something") for name in findings))
    for _ in range(hours):
        trust = judged(trust, update or make_update(trust.time // 300 + 12), found, diagnosis)
    return trust


def level(trust, place=1):
    return trust.horizons[place].level


def test_a_horizon_is_learning_until_enough_was_verified():
    trust = after(Trust(), skill(forecasts=3))
    assert (level(trust, 0), level(trust)) == ("trusted", "learning")
    assert trust.horizons[1].reason == "3 forecasts 6 h ahead were verified in 7 days; it takes 24"
    assert level(after(trust, skill())) == "trusted"


@tabled
def test_a_threshold_that_is_crossed_lowers_the_trust_at_once(week, day, expected, words):
    trust = after(after(Trust(), skill()), skill(day, **week))
    assert level(trust) == expected
    assert words in trust.horizons[1].reason
    assert level(trust, 0) == "trusted"


@pytest.mark.parametrize(("bad", "fallen"), [({"coverage": 0.8}, "doubtful"), ({"coverage": 0.5}, "untrusted")])
def test_trust_comes_back_only_by_a_margin_and_after_hours(bad, fallen):
    trust = after(after(Trust(), skill()), skill(**bad))
    assert level(trust) == fallen
    if fallen == "doubtful":
        # Above the threshold, but not by the margin.
        assert level(after(trust, skill(coverage=0.87), hours=3 * RISES)) == fallen
    assert level(after(trust, skill(), hours=RISES - 1)) == fallen
    assert level(after(trust, skill(), hours=RISES)) == "trusted"
    # One bad hour in between, and it begins anew.
    broken = after(after(trust, skill(), hours=RISES - 1), skill(**bad))
    assert level(after(broken, skill(), hours=RISES - 1)) == fallen


@pytest.mark.parametrize("bad", [{"coverage": 0.5}, {"rmse": 2.0}, {"coverage": 0.8, "rmse": 0.9}])
def test_a_good_last_day_makes_up_for_the_days_before(bad):
    good = {"coverage": 0.95, "rmse": 0.4}
    fallen = after(after(Trust(), skill()), skill(**bad))
    assert level(fallen) != "trusted"
    assert level(after(fallen, skill(good, **bad), hours=RISES - 1)) != "trusted"
    assert level(after(fallen, skill(good, **bad), hours=RISES)) == "trusted"
    for not_enough in ({"forecasts": 11}, {"coverage": 0.86}, {"rmse": 0.79}):
        assert level(after(fallen, skill(good | not_enough, **bad), hours=2 * RISES)) != "trusted"


@tabled
def test_a_fan_that_held_too_little_as_it_was_issued_is_never_trusted(held, expected, words):
    trust = after(Trust(), as_issued(**held))
    one = trust.horizons[1]
    assert (one.level, one.planned) == (expected, "trusted")
    assert words in one.reason
    assert level(trust, 0) == "trusted", "one step ahead nothing is foreseen"
    # What is verified in hindsight goes before, and a plan does not mend it.
    worse = after(trust, as_issued(0.34, coverage=0.5)).horizons[1]
    assert (worse.level, worse.planned) == ("untrusted", "untrusted")


def outdone(arx=0.5, yesterday=0.5, rmse=0.4, day=None, **near):
    """Six hours ahead as `rmse` [K] says, in hindsight and as issued, against the RMSE of simpler forecasts."""
    weeks = (horizon(300, **near), HorizonSkill.of(21600, 100, 0.95, 0.2, rmse, 0.2, 0.8, arx))
    days = (horizon(300, **near), HorizonSkill.of(21600, 24, 0.95, 0.2, rmse if day is None else day, 0.2, 0.8, arx))
    issued = (IssuedSkill(21600, 100, 0.95, 0.2, rmse, 0.2, 0.8, yesterday, 0.2, 0.2),)
    return skill_over(0, {1: days, 7: weeks, 30: weeks}, dict.fromkeys((1, 7, 30), issued))


@tabled
def test_a_model_that_a_simpler_forecast_outdoes_says_so(errors, expected, told, up_to):
    trust = after(Trust(), outdone(**errors))
    assert (trust.horizons[1].level, trust.horizons[1].planned) == (expected, "trusted")
    assert trust.good_up_to == up_to
    assert told in trust.beaten
    assert not told or trust.beaten.endswith("; rely on the model 5 min ahead")
    assert bool(trust.beaten) == bool(told)
    # It is won back as any trust is, and kept between two judgements.
    assert after(trust, None).beaten == trust.beaten
    assert level(after(trust, outdone(), hours=RISES - 1)) == expected
    assert level(after(trust, outdone(), hours=RISES)) == "trusted"


def test_no_reliance_on_a_horizon_that_is_doubted_itself():
    assert after(Trust(), outdone(arx=0.3, coverage=0.8)).beaten.endswith("; do not rely on the model yet")
    good = after(Trust(), outdone(arx=0.3))
    spoiled = after(good, None, update=disturbed())
    for told in (spoiled, untrusted(good, "the zone is stalled"), after(good, None, findings=["unit-changed"])):
        assert told.beaten.endswith("; do not rely on the model now")
    assert named(Trust, stored(spoiled))["beaten"] == spoiled.beaten
    assert after(spoiled, None).beaten == good.beaten
    assert after(good, outdone()).beaten == ""


def test_a_good_day_does_not_show_that_the_heating_is_foreseen():
    trust = after(Trust(), as_issued(0.34))
    assert level(after(trust, as_issued(0.6, day=1.0), hours=3 * RISES)) == "doubtful"
    assert level(after(trust, as_issued(0.87), hours=3 * RISES)) == "doubtful"
    assert level(after(trust, as_issued(0.95), hours=RISES - 1)) == "doubtful"
    back = after(trust, as_issued(0.95), hours=RISES)
    assert (level(back), back.horizons[1].reason) == ("trusted", "")


def test_findings_lower_the_trust_where_they_matter():
    trust = after(Trust(), skill(), findings=["heat-loss-against-balance"])
    assert (level(trust, 0), level(trust)) == ("trusted", "doubtful")
    assert trust.horizons[1].reason == "heat-loss-against-balance; do something"
    trust = after(Trust(), skill(), findings=["forecast-implausible"])
    assert (level(trust, 0), level(trust)) == ("untrusted", "untrusted")
    assert level(after(Trust(), skill(), findings=["parameter-at-bound"])) == "trusted"


def test_telemetry_that_is_not_to_be_believed_takes_all_trust_while_it_lasts():
    lied = after(after(Trust(), skill()), None, findings=["unit-changed"])
    assert (level(lied, 0), level(lied)) == ("untrusted", "untrusted")
    assert {one.planned for one in lied.horizons} == {"untrusted"}
    assert lied.horizons[0].reason == "unit-changed; do something"
    assert level(after(lied, None)) == "trusted"


def disturbed(sd=0.2):
    calm = make_update(20)
    forecast = calm.forecast._replace(outputs=(replace(calm.forecast.outputs[0], sd=sd), *calm.forecast.outputs[1:]))
    return calm._replace(gate=Gate(0.05, "high"), forecast=forecast)


def test_what_acts_now_makes_the_next_hours_doubtful_until_it_is_over():
    trust = after(after(Trust(), skill()), None, update=disturbed())
    assert trust.disturbed
    assert (level(trust, 0), level(trust)) == ("doubtful", "doubtful")
    # A little narrower, still disturbed; then over at once.
    less = disturbed(sd=0.08)
    assert after(trust, None, update=less).disturbed
    assert not after(after(Trust(), skill()), None, update=less).disturbed
    trust = after(trust, None, update=make_update(20))
    assert (trust.disturbed, level(trust)) == (False, "trusted")


def test_a_measurement_that_cannot_be_explained_takes_all_trust_until_the_next():
    trust = after(after(Trust(), skill()), None, update=make_update(20)._replace(outcome="vanished"))
    assert {one.level for one in trust.horizons} == {"untrusted"}
    assert level(after(trust, None)) == "trusted"


def test_the_horizon_of_a_plan_is_the_next_longer_one():
    trust = after(Trust(), skill())
    assert [trust.at(lead).lead for lead in (60, 300, 301, 21600, 90000)] == [300, 300, 21600, 21600, 21600]
    assert Trust().at(60) is None


def test_a_zone_that_cannot_vouch_for_its_forecasts_is_not_trusted():
    told = untrusted(after(Trust(), skill()), "the zone is stalled: no reading of T_out")
    assert {(one.level, one.planned, one.reason) for one in told.horizons} == {
        ("untrusted", "untrusted", "the zone is stalled: no reading of T_out")
    }
