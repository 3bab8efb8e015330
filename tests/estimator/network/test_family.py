"""Variants of a network: the same channels and parameters, and some more."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.errors import OptionsError
from estimator.network.assembly import assemble
from estimator.network.discretise import heat_loss
from estimator.network.family import family, with_direct_heat, with_two_layers
from estimator.network.network import Conductance, HeatInput, Network, Parameter
from estimator.network.presets import PRESETS, automatic, network
from estimator.registry import build

VARIANTS = ("own", "ground", "two-layers", "direct-heat")


@pytest.mark.parametrize("name", PRESETS)
def test_variants_have_the_same_channels_and_all_parameters(name):
    own = network(name)
    found = family(own)
    assert list(found) == [variant for variant in VARIANTS if variant in found]
    assert found["own"] is own
    for variant in list(found.values())[1:]:
        variant.validate()
        assert (variant.inputs, variant.measured) == (own.inputs, own.measured)
        assert set(own.parameters) < set(variant.parameters)
        assert variant.nodes[: len(own.nodes)] == own.nodes


def test_an_automatic_network_has_the_whole_family():
    assert tuple(family(automatic(("T_i", "T_out", "u_heat", "I_sol", "T_adj")))) == VARIANTS


def middle(net, **changes):
    values = [changes.get(p.name, p.nominal or (p.lower * p.upper) ** 0.5) for p in net.parameters]
    return np.array(values)[:, None]


def test_two_layers_with_a_stiff_joint_lose_as_much_as_one():
    own = network("titethria")
    layered = with_two_layers(own)
    joined = heat_loss(assemble(layered, middle(layered, g_layers=1e9)), 0)
    assert joined == pytest.approx(heat_loss(assemble(own, middle(own)), 0), rel=1e-5)
    assert next(edge for edge in layered.conductances if edge.name == "g_e_out").between == ("T_outer", "T_out")


def test_direct_heat_is_a_share_of_all_heat():
    split = with_direct_heat(network("titethria"))
    heat = assemble(split, middle(split, f_direct=0.25)).inputs[0, :, split.inputs.index("u_heat")]
    assert dict(zip(split.nodes, heat, strict=True)) == {"T_i": 0.25, "T_e": 0.0, "T_h": 0.75}


@pytest.mark.parametrize("name", ["tite", "m1", "m5"])
def test_heat_that_already_enters_the_room_is_not_split(name):
    assert with_direct_heat(network(name)) is None


def test_a_network_without_a_node_between_room_and_outdoors_has_no_layers():
    assert with_two_layers(network("m1").with_fixed([])) is not None
    assert with_two_layers(with_two_layers(network("tite"))) is None


def test_a_room_inside_has_no_ground_and_no_outer_layer():
    inside = Network(
        name="inside",
        capacitances={"T_i": "C_i", "T_w": "C_w"},
        boundaries=("T_out",),
        conductances=(Conductance("g", ("T_i", "T_w")),),
        heat_inputs=(HeatInput("u_heat", "T_i"),),
        parameters=(
            Parameter("C_i", "J/K", 1e5, 1e7),
            Parameter("C_w", "J/K", 1e6, 1e8),
            Parameter("g", "W/K", 10.0, 1e3),
        ),
        measured=("T_i",),
    )
    assert tuple(family(inside)) == ("own",)


@pytest.mark.parametrize(
    ("taken", "left_out"), [("T_ground", "ground"), ("g_ground", "ground"), ("T_outer", "two-layers")]
)
def test_a_variant_whose_names_the_network_has_itself_is_left_out(taken, left_out):
    base = network("titeth")
    boundary, edge = (taken, "g_more") if taken.startswith("T_") else ("T_cellar", taken)
    own = replace(
        base,
        boundaries=(*base.boundaries, boundary),
        conductances=(*base.conductances, Conductance(edge, ("T_e", boundary))),
        parameters=(*base.parameters, Parameter(edge, "W/K", 1.0, 1e3)),
    ).validate()
    found = family(own)
    assert set(VARIANTS) - set(found) == {left_out}
    for variant in found.values():
        variant.validate()
    with pytest.raises(OptionsError, match=f"'{left_out}' must be one of own, "):
        build("bank", own, 600.0, {"members": {"a": {"estimator": "ekf", "network": left_out}}})
