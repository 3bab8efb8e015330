"""Parameters at a bound, not identified, and the bounds that data support."""

import tomllib
from dataclasses import replace

import numpy as np
from support.tables import tabled

from estimator.diagnosis.finding import AT_BOUND, NARROWER_BOUNDS, NOT_IDENTIFIED
from estimator.diagnosis.parameters import LEVELS, at_bound, narrower_bounds, not_identified
from estimator.network.presets import SOLAR_APERTURE, network
from estimator.types import ParameterSummary

NETWORK = network("tite")
MIDDLE = (0.45, 0.46, 0.5, 0.54, 0.55)


def summary(**places):
    """Quantiles at `places` in the log boxes; a parameter that is not named was learned well."""
    rows = []
    for parameter in NETWORK.parameters:
        place = np.array(places.get(parameter.name, MIDDLE))
        rows.append(parameter.lower * (parameter.upper / parameter.lower) ** place)
    return ParameterSummary(np.array(LEVELS), np.array(rows), np.ones((2, 5)), np.ones(5))


@tabled
def test_a_posterior_that_leans_against_a_bound_is_a_finding(place, end):
    found = at_bound(NETWORK, summary(C_e=place))
    if end is None:
        assert found == []
        return
    (finding,) = found
    assert (finding.finding, finding.subject) == (AT_BOUND, "C_e")
    assert f"its {end} bound" in finding.sentence
    assert f"parameters.C_e.{end}" in finding.sentence


def test_the_bounds_to_move_are_named_as_the_network_is_written():
    own = replace(NETWORK.with_solar("T_i", SOLAR_APERTURE), name="room-1")
    edge = (0.001, 0.002, 0.02, 0.2, 0.3)
    rows = [parameter.lower * (parameter.upper / parameter.lower) ** np.array(edge) for parameter in own.parameters]
    found = at_bound(own, summary()._replace(parameters=np.array(rows)))
    keys = [finding.sentence.split("; move ")[1].split(" ")[0] for finding in found]
    assert keys[:2] == ["capacitances.T_i.lower", "capacitances.T_e.lower"]
    assert keys[2:] == ["conductances.g_ie.lower", "conductances.g_e_out.lower", "heat_inputs.A_w.lower"]
    assert not any("box" in finding.sentence for finding in found), "only a preset takes a box"


def test_a_posterior_as_wide_as_the_prior_is_not_identified():
    found = not_identified(NETWORK, summary(g_ie=(0.025, 0.05, 0.5, 0.95, 0.975), C_i=(0.1, 0.2, 0.5, 0.8, 0.9)))
    assert [(finding.finding, finding.subject) for finding in found] == [(NOT_IDENTIFIED, "g_ie")]


def test_a_fixed_parameter_and_one_without_quantiles_bring_no_finding():
    net = NETWORK.with_fixed(["C_e"])
    nothing = summary()._replace(parameters=np.full((4, 5), np.nan))
    fixed = summary(C_e=(0.0, 0.0, 0.0, 0.0, 0.0))
    for function in (at_bound, not_identified):
        assert function(net, fixed) == []
        assert function(NETWORK, nothing) == []


def test_proposed_bounds_contain_the_interval_and_stay_in_the_box():
    (finding,) = narrower_bounds(NETWORK, summary(g_ie=(0.025, 0.05, 0.5, 0.95, 0.975)), 7.0)
    assert (finding.finding, finding.subject) == (NARROWER_BOUNDS, "zone")
    assert "--reset" in finding.sentence
    table = finding.sentence.split("bounds, ")[1].split("; to adopt")[0]
    proposed = tomllib.loads(table)["parameters"]
    assert set(proposed) == {"C_i", "C_e", "g_e_out"}
    for name, bounds in proposed.items():
        quantiles = summary().parameters[[p.name for p in NETWORK.parameters].index(name)]
        assert bounds["lower"] < quantiles[0] < quantiles[-1] < bounds["upper"]
        assert NETWORK.parameter(name).lower <= bounds["lower"] < bounds["upper"] <= NETWORK.parameter(name).upper


def test_nothing_is_proposed_where_nothing_was_learned():
    prior = dict.fromkeys((p.name for p in NETWORK.parameters), (0.025, 0.05, 0.5, 0.95, 0.975))
    assert narrower_bounds(NETWORK, summary(**prior), 7.0) == []
