"""From the network table of a zone to the estimator's network."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from support.config_samples import inline_network

from estimator.network import presets
from estimator.network.network import Conductance, Gain, HeatInput, InitialTemperature, Network, Parameter
from service.config.network_tables import InlineConfig, PresetConfig
from service.config.networks import preset_network, resolve
from service.config.written import network_table
from service.errors import ConfigError


def built(table: dict[str, Any]) -> Network:
    network, mistakes = resolve(PresetConfig.model_validate(table))
    assert not mistakes
    assert network is not None
    return network


def built_inline(table: dict[str, Any]) -> Network:
    network, mistakes = resolve(InlineConfig.model_validate(table))
    assert not mistakes
    assert network is not None
    return network


@pytest.mark.parametrize("name", presets.PRESETS)
def test_a_preset_by_name_is_the_preset(name: str) -> None:
    assert built({"preset": name}) == presets.network(name)


@pytest.mark.parametrize("name", presets.PRESETS)
def test_a_preset_written_out_as_inline_network_is_the_same_network(name: str) -> None:
    preset = presets.network(name)

    again = built_inline(network_table(preset))

    initial = {node: preset.initial_temperature(node) for node in preset.nodes}
    assert replace(again, parameters=set(again.parameters)) == replace(  # type: ignore[arg-type]
        preset,
        parameters=set(preset.parameters),  # type: ignore[arg-type]
        description="",
        initial=initial,
    )


def test_parameters_change_bounds_nominal_and_value() -> None:
    network = built(
        {
            "preset": "titeth",
            "parameters": {
                "C_i": {"lower": 1e6, "upper": 1e7},
                "C_e": {"nominal": 3e7},
                "g_ie": {"value": 444.0},
            },
        }
    )

    preset = presets.titeth()
    assert network.parameter("C_i") == Parameter("C_i", "J/K", 1e6, 1e7, 2e6)
    assert network.parameter("C_e") == replace(preset.parameter("C_e"), nominal=3e7)
    assert network.parameter("g_ie") == replace(preset.parameter("g_ie"), nominal=444.0, free=False)
    assert network.parameter("g_ih") == preset.parameter("g_ih")


def test_fixed_parameters_stay_at_their_nominal_value() -> None:
    network = built({"preset": "titeth", "fixed": ["C_h", "C_i"], "parameters": {"C_i": {"nominal": 3e6}}})

    assert [parameter.name for parameter in network.free] == ["C_e", "g_ie", "g_e_out", "g_ih"]
    assert network.parameter("C_h").nominal == presets.titeth().parameter("C_h").nominal
    assert network.parameter("C_i").nominal == 3e6


def test_a_fixed_parameter_may_lie_outside_the_bounds_it_does_not_use() -> None:
    network = built({"preset": "titeth", "fixed": ["C_i"], "parameters": {"C_i": {"nominal": 1e9}}})

    assert network.parameter("C_i").nominal == 1e9


@pytest.mark.parametrize(
    ("solar", "node", "aperture"),
    [
        (True, "T_i", presets.SOLAR_APERTURE),
        ({}, "T_i", presets.SOLAR_APERTURE),
        ({"node": "T_e", "lower": 0.5, "upper": 20}, "T_e", Parameter("A_w", "m2", 0.5, 20, 3.0)),
        ({"upper": 2.0}, "T_i", Parameter("A_w", "m2", 0.1, 2.0, None)),
        ({"value": 4.5}, "T_i", replace(presets.SOLAR_APERTURE, nominal=4.5, free=False)),
    ],
)
def test_solar_aperture(solar: object, node: str, aperture: Parameter) -> None:
    network = built({"preset": "titeth", "solar": solar})

    assert network.channels == ("T_i", "T_out", "u_heat", "I_sol")
    assert network.heat_inputs[-1] == HeatInput("I_sol", node, Gain(parameter="A_w"), "W/m2")
    assert network.parameter("A_w") == aperture


def test_no_solar() -> None:
    assert built({"preset": "titeth", "solar": False}) == presets.titeth()


def test_solar_aperture_is_a_parameter_like_the_others() -> None:
    network = built({"preset": "tite", "solar": True, "parameters": {"A_w": {"nominal": 7.0}}, "fixed": ["A_w"]})

    assert not network.parameter("A_w").free
    assert network.parameter("A_w").nominal == 7.0


def test_initial_temperatures_change_what_they_say_and_keep_the_rest() -> None:
    network = built(
        {
            "preset": "titeth",
            "initial": {"T_e": {"source": "T_out"}, "T_h": {"source": 35, "sd": 9}, "T_i": {"sd": 0.1}},
        }
    )

    assert network.initial == {
        "T_e": InitialTemperature("T_out", 3.0),
        "T_h": InitialTemperature(35.0, 9.0),
        "T_i": InitialTemperature("measured", 0.1),
    }


def test_inline_network() -> None:
    network = built_inline(inline_network())

    assert network == Network(
        name="attic",
        capacitances={"T_air": "C_air", "T_wall": "C_w"},
        boundaries=("T_out",),
        conductances=(
            Conductance("g_air_wall", ("T_air", "T_wall")),
            Conductance("g_wall_out", ("T_wall", "T_out")),
        ),
        heat_inputs=(
            HeatInput("u_heat", "T_air", Gain(parameter="f_air")),
            HeatInput("u_heat", "T_wall", Gain(1.0, "f_air", -1.0)),
            HeatInput("I_sol", "T_air", Gain(parameter="A_w"), "W/m2"),
            HeatInput("n_people", "T_air", Gain(80.0), "people"),
        ),
        parameters=(
            Parameter("C_air", "J/K", 1e5, 1e7),
            Parameter("C_w", "J/K", 4e6, 4e6, 4e6, free=False),
            Parameter("g_air_wall", "W/K", 10, 5000),
            Parameter("g_wall_out", "W/K", 5, 500, 60),
            Parameter("f_air", "1", 0.02, 0.98),
            Parameter("A_w", "m2", 4.5, 4.5, 4.5, free=False),
        ),
        measured=("T_air",),
        initial={"T_wall": InitialTemperature("T_out", 4.0)},
    )
    assert network.channels == ("T_air", "T_out", "u_heat", "I_sol", "n_people")


def test_inline_gain_is_one_watt_per_watt_unless_told() -> None:
    table = inline_network() | {"heat_inputs": [{"channel": "u_heat", "node": "T_air"}]}

    assert built_inline(table).heat_inputs == (HeatInput("u_heat", "T_air", Gain(1.0), "W"),)


def test_inline_gain_of_an_own_unit_is_named_after_it() -> None:
    gain = {"name": "q_person", "lower": 50, "upper": 150}
    heat = {"channel": "n_people", "node": "T_air", "unit": "people", "gain": gain}

    assert built_inline(inline_network() | {"heat_inputs": [heat]}).parameter("q_person").unit == "W per people"


def test_network_without_heat_inputs() -> None:
    table = inline_network()
    del table["heat_inputs"]

    assert built_inline(table).channels == ("T_air", "T_out")


def test_preset_with_overrides() -> None:
    network = preset_network("tite", ["solar=true", "parameters.C_i.lower=1e6"])

    assert network.parameter("C_i").lower == 1e6
    assert "I_sol" in network.channels


@pytest.mark.parametrize(
    ("name", "overrides", "problem"),
    [
        ("titet", [], 'preset: unknown network "titet"'),
        ("tite", ["solr=true"], "solr: is not a known key"),
        ("tite", ["parameters.C_x.value=1"], 'parameters.C_x: network "tite" has no parameter "C_x"'),
        ("tite", ['fixed=["C_x"]'], 'fixed[0]: network "tite" has no parameter "C_x"'),
    ],
)
def test_preset_with_wrong_overrides(name: str, overrides: list[str], problem: str) -> None:
    with pytest.raises(ConfigError) as caught:
        preset_network(name, overrides)

    assert len(caught.value.problems) == 1
    assert caught.value.problems[0].startswith(problem)
