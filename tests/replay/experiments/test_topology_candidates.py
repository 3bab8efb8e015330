"""M1-M8 for the Ecolar zone and for whatever channels a zone has."""

from dataclasses import replace

import pytest

from estimator.network import presets
from estimator.network.network import Conductance, Gain, HeatInput, InitialTemperature, Network, Parameter
from replay.experiments.topology.candidates import OWN, candidates_for, ecolar_candidates


def test_ecolar_has_the_papers_eight_with_and_without_sun() -> None:
    found = ecolar_candidates(True)
    assert [candidate.name for candidate in found[:3]] == ["M1", "M1 with sun", "M2"]
    assert [len(c.network.nodes) for c in found if not c.solar] == [2, 3, 3, 4, 4, 4, 5, 5]  # Table 2
    assert all(("I_sol" in c.network.inputs) == c.solar for c in found)
    assert len(ecolar_candidates(False)) == 8


def test_a_zone_with_the_ecolar_channels_gets_the_same_structures() -> None:
    presets_by_label = {c.label: c.network for c in ecolar_candidates(False)}
    for candidate in candidates_for(presets.network("ecolar-6r4c")):
        if candidate.label == OWN:
            continue
        theirs = presets_by_label[candidate.label]
        assert set(candidate.network.nodes) == set(theirs.nodes), candidate.label
        assert edges(candidate.network) == edges(theirs), candidate.label
        assert {h.node for h in candidate.network.heat_inputs} == {h.node for h in theirs.heat_inputs}
        assert set(candidate.network.channels) == set(theirs.channels)


@pytest.mark.parametrize("names", [("T_next", "T_out"), ("T_corridor", "T_amb"), ("T_next", "T_out", "T_extension")])
def test_outdoors_is_known_by_its_name_wherever_it_stands(names: tuple[str, ...]) -> None:
    outdoors = names[1]
    own = replace(
        presets.network("tite"),
        boundaries=names,
        conductances=(
            *(Conductance(f"g_{name}", ("T_i", name)) for name in names),
            Conductance("g_ie", ("T_i", "T_e")),
        ),
        parameters=(
            *(Parameter(f"g_{name}", "W/K", 1.0, 1e3) for name in (*names, "ie")),
            *(parameter for parameter in presets.network("tite").parameters if parameter.unit == "J/K"),
        ),
    ).validate()
    simplest = next(candidate.network for candidate in candidates_for(own) if candidate.label == "M1")
    assert {frozenset(("T_i", outdoors)), frozenset(("T_wo", outdoors))} <= edges(simplest)


def edges(network: Network) -> set[frozenset[str]]:
    return {frozenset(edge.between) for edge in network.conductances}


def test_without_an_adjacent_room_nothing_appears_twice() -> None:
    own = presets.network("titeth")
    found = candidates_for(own)
    assert [candidate.label for candidate in found] == [OWN, "M1", "M2", "M5", "M6", "M7", "M8"]
    assert found[0].network == own
    assert all(set(c.network.channels) == set(own.channels) for c in found)


def test_sun_in_the_own_network_makes_twins_with_and_without() -> None:
    own = presets.network("titethria").with_solar("T_e", presets.SOLAR_APERTURE, "I_south")
    found = candidates_for(own)
    assert [c.name for c in found[:2]] == [OWN, f"{OWN} with sun"]
    assert found[0].network == replace(presets.network("titethria"), heat_inputs=own.heat_inputs[:1])
    assert found[1].network == own
    assert {c.solar for c in found if c.label == "M2"} == {True, False}
    lit = next(c.network for c in found if c.name == "M2 with sun")
    assert lit.heat_inputs[-1] == HeatInput("I_south", "T_i", Gain(parameter="A_w"), "W/m2")


def test_without_a_heater_no_candidate_has_a_heater_node() -> None:
    found = candidates_for(replace(presets.network("tite"), heat_inputs=()))
    assert all("T_h" not in c.network.nodes and not c.network.heat_inputs for c in found)
    assert [c.label for c in found] == [OWN, "M1", "M6", "M7", "M8"]


def test_names_that_the_zone_has_taken_are_avoided() -> None:
    own = Network(
        name="odd",
        capacitances={"T_h": "C_h"},
        boundaries=("T_wo", "T_outside", "T_wi"),
        conductances=tuple(Conductance(f"g_{b}", ("T_h", b)) for b in ("T_wo", "T_outside", "T_wi")),
        heat_inputs=(HeatInput("u_a", "T_h"), HeatInput("u_b", "T_h", Gain(parameter="f_air"))),
        parameters=(
            Parameter("C_h", "J/K", 1e5, 1e8),
            *(Parameter(f"g_{b}", "W/K", 1.0, 1e3) for b in ("T_wo", "T_outside", "T_wi")),
            Parameter("f_air", "1", 0.1, 2.0),
        ),
        measured=("T_h",),
        initial={"T_h": InitialTemperature("T_wo", 1.0)},
    ).validate()
    found = {c.label: c.network for c in candidates_for(own)}
    assert len(found) == 9
    m5 = found["M5"]
    assert m5.initial_temperature("T_wo2").source == "T_outside"
    assert set(m5.nodes) == {"T_h", "T_wo2", "T_wi2", "T_wi3", "T_h2"}
    # The heater is the first input in W; what else heats keeps its gain.
    assert [h.channel for h in m5.heat_inputs] == ["u_a", "u_a", "u_b"]
    assert m5.heat_inputs[-1].gain == Gain(parameter="f_air")
    assert {p.name for p in m5.parameters} >= {"f_air", "f_air2"}
