"""Validation says what is wrong with a network in the user's words."""

from dataclasses import replace

import pytest

from estimator.errors import NetworkError
from estimator.network.network import Conductance, Gain, HeatInput, InitialTemperature, Parameter
from estimator.network.presets import SOLAR_APERTURE, network


def tite(**changes):
    return replace(network("tite"), **changes)


def with_edges(*edges):
    base = network("tite")
    extra = [Parameter(edge.name, "W/K", 1.0, 10.0) for edge in edges]
    return replace(base, conductances=(*base.conductances, *edges), parameters=(*base.parameters, *extra))


PARAMETERS = network("tite").parameters

MISTAKES = {
    "no state node": (tite(capacitances={}), "no state node"),
    "no boundary": (tite(boundaries=()), "no boundary node"),
    "boundary alone": (tite(boundaries=("T_out", "T_ground")), "'T_ground' has no conductance"),
    "boundaries joined": (
        replace(with_edges(Conductance("g_b", ("T_out", "T_ground"))), boundaries=("T_out", "T_ground")),
        "connects two boundary nodes",
    ),
    "one name twice": (tite(boundaries=("T_out", "T_i")), "'T_i' is used for two"),
    "nothing measured": (tite(measured=()), "no node is measured"),
    "measured unknown": (tite(measured=("T_x",)), "'T_x' is not a state node; the state nodes are T_i, T_e"),
    "measured twice": (tite(measured=("T_i", "T_i")), "listed twice"),
    "initial unknown node": (tite(initial={"T_x": InitialTemperature()}), "'T_x', which is not a state node"),
    "initial unknown source": (tite(initial={"T_e": InitialTemperature("T_sky")}), "comes from 'T_sky'"),
    "initial sd": (tite(initial={"T_e": InitialTemperature(20.0, 0.0)}), "greater than 0 K"),
    "bound reversed": (network("tite").with_parameter("C_i", lower=2e7, upper=1e6), "the lower one must be smaller"),
    "bound zero": (network("tite").with_parameter("C_i", lower=0.0), "needs a bound above 0"),
    "bound nan": (network("tite").with_parameter("C_i", upper=float("nan")), "the lower one must be smaller"),
    "bound absurd": (network("tite").with_parameter("C_i", lower=1e-300), "outside 1e-06 to 1e+13 J/K"),
    "span": (network("tite").with_parameter("g_ie", lower=1e-5, upper=1e5), "more than a factor of 1e+09"),
    "fixed without value": (
        network("tite").with_parameter("C_i", free=False, nominal=None),
        "'C_i' is not free and has no value",
    ),
    "negative value": (network("tite").with_parameter("C_i", free=False, nominal=-1.0), "must be a positive number"),
    "parameter twice": (tite(parameters=(*PARAMETERS, PARAMETERS[0])), "'C_i' is defined twice"),
    "parameter missing": (tite(parameters=PARAMETERS[1:]), "'C_i' is used but has neither"),
    "parameter unused": (tite(parameters=(*PARAMETERS, Parameter("x", "1", 1, 2))), "'x' is defined but nothing uses"),
    "parameter shared": (tite(capacitances={"T_i": "C_i", "T_e": "C_i"}), "stands for two elements"),
    "unknown node": (with_edges(Conductance("g", ("T_i", "T_x"))), "unknown node 'T_x'"),
    "self loop": (with_edges(Conductance("g", ("T_i", "T_i"))), "connects 'T_i' with itself"),
    "parallel": (with_edges(Conductance("g", ("T_e", "T_i"))), "connect the same two nodes"),
    "heat into nowhere": (tite(heat_inputs=(HeatInput("u", "T_x"),)), "enters 'T_x', which is not a state node"),
    "heat twice": (tite(heat_inputs=(HeatInput("u", "T_i"), HeatInput("u", "T_i"))), "enters 'T_i' twice"),
    "heat in two units": (
        tite(heat_inputs=(HeatInput("u", "T_i"), HeatInput("u", "T_e", unit="kW"))),
        "is given in W and in kW",
    ),
    "gain is an element": (
        tite(heat_inputs=(HeatInput("u", "T_i", Gain(parameter="C_i")),)),
        "both an element of the network and the gain",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named(mistake):
    broken, gist = MISTAKES[mistake]
    with pytest.raises(NetworkError, match="network 'tite'") as caught:
        broken.validate()
    assert gist in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_node_without_a_way_to_a_boundary_is_named():
    base = network("titeth")
    kept = [edge for edge in base.conductances if edge.name != "g_ih"]
    loose = replace(base, conductances=tuple(kept), parameters=tuple(p for p in base.parameters if p.name != "g_ih"))
    with pytest.raises(NetworkError, match="'T_h' is not tied to any boundary"):
        loose.validate()


def test_inputs_are_boundaries_then_heat_and_one_channel_may_feed_two_nodes():
    split = network("m5")
    assert split.inputs == ("T_out", "T_adj", "u_heat")
    assert split.channels == ("T_air", "T_out", "T_adj", "u_heat")
    assert split.channel_unit("u_heat") == "W"
    assert split.channel_unit("T_adj") == "degC"
    with pytest.raises(NetworkError, match="no channel 'I_sol'; it has T_air, T_out, T_adj, u_heat"):
        split.channel_unit("I_sol")


def test_solar_adds_a_channel_and_a_free_aperture():
    sunny = network("titeth").with_solar("T_i", SOLAR_APERTURE).validate()
    assert sunny.inputs[-1] == "I_sol"
    assert sunny.channel_unit("I_sol") == "W/m2"
    assert sunny.free[-1].name == "A_w"
    with pytest.raises(NetworkError, match="already has the heat input 'I_sol'"):
        sunny.with_solar("T_i", SOLAR_APERTURE)


def test_a_meter_of_several_zones_has_a_learned_share():
    shared = network("titeth").with_share("u_heat", 0.2).validate()
    assert shared.shares == {"u_heat": len(shared.parameters) - 1}
    assert (shared.free[-1].name, shared.free[-1].typical, shared.free[-1].upper) == ("share_u_heat", 0.2, 1.0)
    assert shared.with_share("u_heat", 0.5) == network("titeth").with_share("u_heat", 0.5)
    assert network("titeth").shares == {}
    with pytest.raises(NetworkError, match="has gains of 'u_heat' of its own"):
        network("m5").with_share("u_heat", 0.2)


def test_fixing_a_parameter_leaves_the_others_free():
    fixed = network("building-67").with_fixed(["C_i", "C_h", "C_s", "g_is"])
    assert [p.name for p in fixed.free] == ["C_m", "C_e", "g_im", "g_ie", "g_ih", "g_e_out"]
    with pytest.raises(NetworkError, match="no parameter 'C_x'; it has C_i, C_m"):
        fixed.with_fixed(["C_x"])
