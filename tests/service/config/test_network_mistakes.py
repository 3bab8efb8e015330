"""Every mistake in the network of a zone is said in one sentence, with its exact place and a remedy."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.config_spoiling import LIVING, NETWORK, Change, at, check_mistake, inline, living, preset, problems_of

# What is changed; where it must be reported; what must be said.
MISTAKES: dict[str, tuple[Change, str, tuple[str, ...]]] = {
    "no network": (living(network=None), f"{LIVING}.network", ("is missing", "preset")),
    "unknown preset": (living(network="titet"), NETWORK, ('unknown network "titet"', 'did you mean "titeth"?')),
    "unknown preset in a table": (preset(preset="m9"), f"{NETWORK}.preset", ('unknown network "m9"', "m1, m2")),
    "network is a number": (living(network=7), NETWORK, ("a preset such as", "not 7")),
    "unknown parameter": (
        preset(parameters={"C_j": {"value": 1e6}}),
        f"{NETWORK}.parameters.C_j",
        ('"tite" has no parameter "C_j"', "C_i, C_e, g_ie, g_e_out"),
    ),
    "bound reversed": (
        preset(parameters={"C_i": {"lower": 1e7, "upper": 1e5}}),
        f"{NETWORK}.parameters.C_i",
        ("lower = 1e+07 is not below upper = 100000", "swap"),
    ),
    "bound above the preset's other bound": (
        preset(parameters={"C_i": {"lower": 1e9}}),
        f"{NETWORK}.parameters.C_i",
        ("lower = 1e+09 is not below upper = 1e+08", "the preset's"),
    ),
    "non-positive bound": (
        preset(parameters={"C_i": {"lower": 0}}),
        f"{NETWORK}.parameters.C_i.lower",
        ("greater than 0, not 0",),
    ),
    "value next to nothing": (
        preset(parameters={"C_i": {"value": 1e-300}}),
        NETWORK,
        ("value 1e-300", "no building needs it"),
    ),
    "initial temperature beyond measure": (
        preset(initial={"T_e": {"source": 1e300, "sd": 1.0}}),
        f"{NETWORK}.initial.T_e.source",
        ("from -273.15 to 10000 degC", "not 1e+300"),
    ),
    "infinite bound": (
        preset(parameters={"C_i": {"upper": float("inf")}}),
        f"{NETWORK}.parameters.C_i.upper",
        ("must be a number",),
    ),
    "nominal outside the bounds": (
        preset(parameters={"C_i": {"lower": 1e5, "upper": 1e6, "nominal": 2e6}}),
        f"{NETWORK}.parameters.C_i",
        ("nominal = 2e+06 lies outside",),
    ),
    "nominal outside the preset's bounds": (
        preset(parameters={"C_i": {"nominal": 1e9}}),
        f"{NETWORK}.parameters.C_i",
        ("nominal = 1e+09 lies outside the bounds 100000 and 1e+08", "the preset's"),
    ),
    "value and bounds": (
        preset(parameters={"C_i": {"lower": 1e5, "value": 2e6}}),
        f"{NETWORK}.parameters.C_i",
        ("both a value", "one of the two"),
    ),
    "unknown fixed parameter": (preset(fixed=["C_x"]), f"{NETWORK}.fixed[0]", ('no parameter "C_x"', "C_i, C_e")),
    "fixed without a nominal value": (
        preset(fixed=["C_i"], parameters={"C_i": {"lower": 1e7}}),
        f"{NETWORK}.fixed[0]",
        ("no nominal value", "value = ..."),
    ),
    "solar is a number": (preset(solar=4), f"{NETWORK}.solar", ("must be true, or a table",)),
    "solar into an unknown node": (
        preset(solar={"node": "T_x"}),
        f"{NETWORK}.solar.node",
        ('"T_x" is not a state node', "T_i, T_e"),
    ),
    "solar bound above the default one": (preset(solar={"lower": 40}), f"{NETWORK}.solar", ("lower = 40",)),
    "solar twice": (
        living(network={"preset": "building-67", "solar": True}),
        f"{NETWORK}.solar",
        ("already has the heat input 'I_sol'", "remove solar"),
    ),
    "initial of an unknown node": (preset(initial={"T_x": {}}), f"{NETWORK}.initial.T_x", ("not a state node",)),
    "initial from an unknown node": (
        preset(initial={"T_e": {"source": "T_ou"}}),
        f"{NETWORK}.initial.T_e.source",
        ('"T_ou" is no starting point', "measured, T_out"),
    ),
    "initial source is a list": (
        preset(initial={"T_e": {"source": []}}),
        f"{NETWORK}.initial.T_e.source",
        ('"measured", the name of a boundary node', "degC"),
    ),
    "initial sd of zero": (preset(initial={"T_e": {"sd": 0}}), f"{NETWORK}.initial.T_e.sd", ("greater than 0",)),
    "disconnected node": (
        inline("capacitances", T_roof={"lower": 1e5, "upper": 1e7}),
        NETWORK,
        ("node 'T_roof' is not tied to any boundary node (T_out)", "add the missing conductance"),
    ),
    "unknown node in a conductance": (
        inline("conductances", 1, between=["T_wall", "T_uot"]),
        f"{NETWORK}.conductances[1].between[1]",
        ('unknown node "T_uot"', 'did you mean "T_out"?'),
    ),
    "conductance between three nodes": (
        inline("conductances", 0, between=["T_air", "T_wall", "T_out"]),
        f"{NETWORK}.conductances[0].between",
        ("the two nodes",),
    ),
    "conductance without bounds": (
        inline("conductances", 0, lower=None),
        f"{NETWORK}.conductances[0]",
        ("needs lower and upper", "or value"),
    ),
    "unknown node of a heat input": (
        inline("heat_inputs", 2, node="T_out"),
        f"{NETWORK}.heat_inputs[2].node",
        ('unknown node "T_out"', "T_air, T_wall"),
    ),
    "rest of an unknown gain": (
        inline("heat_inputs", 1, gain={"rest_of": "f_aer"}),
        f"{NETWORK}.heat_inputs[1].gain.rest_of",
        ('no heat input has a gain called "f_aer"', 'did you mean "f_air"?'),
    ),
    "gain is a text": (inline("heat_inputs", 0, gain="f"), f"{NETWORK}.heat_inputs[0].gain", ("must be a number",)),
    "gain without a name": (
        inline("heat_inputs", 0, gain={"lower": 1, "upper": 2}),
        f"{NETWORK}.heat_inputs[0].gain",
        ("must be a number", "rest_of"),
    ),
    "gain is a number with bounds": (
        inline("heat_inputs", 1, gain={"rest_of": "f_air", "lower": 1}),
        f"{NETWORK}.heat_inputs[1].gain",
        ("no name",),
    ),
    "no measured node": (inline(measured=[]), NETWORK, ("no node is measured",)),
    "no measured key": (inline(measured=None), f"{NETWORK}.measured", ("is missing", '["T_air"]')),
    "unknown measured node": (inline(measured=["T_w"]), NETWORK, ("measured node 'T_w' is not a state node",)),
    "node name with a slash": (
        inline("capacitances", **{"a/b": {"value": 1.0}}),
        f'{NETWORK}.capacitances."a/b"',
        ('"a/b" cannot be a name',),
    ),
    "unit of a heat input of its own": (
        lambda tables: (inline()(tables), at("zones", 0, "channels", "n_people", unit="heads")(tables)),
        f"{LIVING}.channels.n_people.unit",
        ("'heads' cannot be converted to 'people'",),
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistake_is_one_sentence_at_its_place(name: str, tmp_path: Path) -> None:
    check_mistake(tmp_path, *MISTAKES[name])


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_not_followed_by_others_that_it_caused(name: str, tmp_path: Path) -> None:
    assert len(problems_of(tmp_path, MISTAKES[name][0])) == 1
