"""The picture of a network: everything is in it, nothing stands on anything else, and names stay text."""

import math
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest

from estimator.network import presets
from estimator.network.network import Parameter
from replay.reports.drawing import picture

SVG = "{http://www.w3.org/2000/svg}"


def drawn(network, values=None):
    return ET.fromstring(picture(network, values or {}))


@pytest.mark.parametrize("name", sorted(presets.PRESETS))
def test_everything_of_a_preset_is_in_its_picture(name):
    network = presets.network(name)
    root = drawn(network)
    words = [text.text for text in root.iter(f"{SVG}text")]
    assert set(network.nodes) | set(network.boundaries) | set(network.capacitances.values()) <= set(words)
    assert {edge.name for edge in network.conductances} <= set(words)
    for heat in network.heat_inputs:
        assert any(word.startswith(heat.channel) for word in words)
    circles = [(float(c.get("cx")), float(c.get("cy"))) for c in root.iter(f"{SVG}circle")]
    boxes = [(float(r.get("x")) + 34, float(r.get("y")) + 20) for r in root.iter(f"{SVG}rect")]
    assert (len(circles), len(boxes)) == (len(network.nodes), len(network.boundaries))
    bodies = [*circles, *boxes]
    for place, one in enumerate(bodies):
        assert all(math.dist(one, other) > 100 for other in bodies[place + 1 :])
    width, height = map(float, root.get("viewBox").split()[2:])
    assert all(34 < x < width - 34 and 34 < y < height - 34 for x, y in bodies)


def test_values_stand_beside_their_parameters():
    words = [text.text for text in drawn(presets.network("tite"), {"g_ie": 181.49, "C_i": 2.04e6}).iter(f"{SVG}text")]
    assert {"g_ie 181 W/K", "C_i 2.04e6 J/K", "g_e_out"} <= set(words)


def test_a_hostile_name_is_text():
    hostile = "<script>alert('1')</script>"
    network = presets.network("tite")
    first = network.heat_inputs[0]
    named = replace(network, heat_inputs=(replace(first, channel=hostile),))
    root = drawn(named)
    assert hostile in [text.text for text in root.iter(f"{SVG}text")]
    assert not list(root.iter(f"{SVG}script"))


def test_the_style_of_the_picture_leaves_the_rest_of_the_page_alone():
    style = next(drawn(presets.network("tite")).iter(f"{SVG}style")).text
    assert all(rule.startswith(".network ") for rule in style.split("}")[:-1])


def test_a_learned_gain_stands_beside_its_input():
    network = presets.network("tite").with_solar("T_i", Parameter("A_w", "m2", 0.1, 50.0), "I_sol").validate()
    assert "I_sol × A_w 3.2 m2" in [text.text for text in drawn(network, {"A_w": 3.2}).iter(f"{SVG}text")]
