"""Facts of public studies as priors."""

import numpy as np
import pytest

from estimator.heat.terms import HABIT_HOURS, with_known_heat
from estimator.network.assembly import assemble
from estimator.network.boxes import TYPICAL_AREA
from estimator.network.buildings import AGES, CONSTRUCTIONS, NOTHING_KNOWN, SPREAD, USES, Building, informed
from estimator.network.discretise import heat_loss
from estimator.network.presets import automatic, network
from estimator.network.space import parameter_space

AUTO = automatic(["I_sol"])


def typical(net):
    return np.array([[parameter.typical or parameter.nominal] for parameter in net.parameters])


def test_who_says_nothing_has_the_prior_of_before():
    assert informed(AUTO, NOTHING_KNOWN, None) == AUTO
    assert informed(AUTO, NOTHING_KNOWN, 30.0) == AUTO


@pytest.mark.parametrize("name", ["auto", "titethria", "titeth", "tite"])
@pytest.mark.parametrize("year", [1900, 1985, 2020])
def test_a_typical_room_loses_what_the_study_says(name, year):
    net = informed(AUTO if name == "auto" else network(name), Building(built=year), 70.0)
    (age,) = [one for one in AGES if one.since <= year][-1:]
    expected = 70.0 * (0.6 * age.opaque + age.glazed + 0.5)
    # Where nobody says what is typical, the inner path is that in the middle of its bounds.
    theta = typical(net)
    for row, parameter in enumerate(net.parameters):
        theta[row] = parameter.typical or np.sqrt(parameter.lower * parameter.upper)
    assert heat_loss(assemble(net, theta), 0)[0] == pytest.approx(expected, rel=1e-6)


def test_later_years_lose_less_and_heavier_buildings_hold_more():
    losses = [heat_loss(assemble(net, typical(net)), 0)[0] for net in (
        informed(AUTO, Building(built=year), None) for year in (1000, 1969, 1979, 1995, 2002, 2016)
    )]  # fmt: skip
    assert losses == sorted(losses, reverse=True)
    held = [informed(AUTO, Building(construction=name), 30.0).parameter("C_e").typical for name in CONSTRUCTIONS]
    assert held == sorted(held)
    assert held[3] == pytest.approx(30.0 * 2.6e5)


@pytest.mark.parametrize(("area", "spread"), [(30.0, SPREAD), (None, np.hypot(SPREAD, 0.7))])
def test_draws_lie_about_the_fact_and_an_unknown_area_makes_them_wider(area, spread):
    net = informed(AUTO, Building("medium"), area)
    place = np.random.default_rng(1).random((len(net.free), 4000))
    space = parameter_space(net, logit=False)
    row = [parameter.name for parameter in net.free].index("C_e")
    drawn = space.from_uniform(place)[row]
    assert drawn.mean() == pytest.approx(np.log(1.65e5 * (area or TYPICAL_AREA)), abs=4 * spread / np.sqrt(4000))
    assert drawn.std() == pytest.approx(spread, rel=4 / np.sqrt(2 * 4000))
    assert space.prior_variance[row] == pytest.approx(spread**2)
    assert space.from_uniform(place, 0.5)[row].std() == pytest.approx(0.5 * spread, rel=0.1)


def test_what_lies_beyond_the_bounds_counts_as_the_bound():
    small = automatic().with_parameter("C_e", upper=5e6, typical=3e6)
    assert informed(small, Building("very-heavy"), 100.0).parameter("C_e").typical == 5e6


def test_a_path_to_the_outdoors_that_is_fixed_is_not_counted_in_the_walls_as_well():
    fixed = AUTO.with_parameter("g_i_out", nominal=40.0, free=False)
    told, learned = (informed(net, Building(built=1985), 70.0) for net in (fixed, AUTO))
    assert told.parameter("g_e_out") == learned.parameter("g_e_out")
    assert told.parameter("g_i_out") == fixed.parameter("g_i_out")


def test_a_known_use_is_expected_by_the_hour():
    plain, office = (with_known_heat(AUTO, habits=True, floor_area=30.0, use=use) for use in (None, "office"))
    expected = {term.name: term for term in office.terms}
    assert [term.name for term in plain.terms] == list(expected)
    assert expected["habit_12"].mean == pytest.approx(12.0 * 30.0)
    assert expected["habit_weekend_12"].mean == pytest.approx(-10.0 * 30.0)
    assert expected["habit_12"].sd == pytest.approx(6.0 * 30.0)
    assert expected["habit_00"].sd == next(term.sd for term in plain.terms)
    for gains in USES.values():
        assert len(gains.workdays) == len(gains.weekend) == len(HABIT_HOURS)
        assert all(np.add(*gains) >= 0.0)
