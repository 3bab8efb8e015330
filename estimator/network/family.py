"""A small family of networks over the same channels, for a zone whose network nobody has chosen.

Every variant adds to the network and takes nothing away: it has the same inputs, outputs and parameters, and some more.
So variants can stand beside each other in a bank, and what one of them learns can be told in the terms of the others.
"""

from dataclasses import replace

from estimator.network.network import Conductance, Gain, HeatInput, InitialTemperature, Network, Parameter

GROUND = "T_ground"
_GROUND_CAPACITANCE = 1e12
"""J/K: so large that nothing a zone does changes the temperature of the ground."""
_GROUND_TEMPERATURE, _GROUND_SD = 12.0, 4.0

OUTER = "T_outer"
_OUTER_SD = 3.0
_SHARE = Parameter("f_direct", "1", 0.02, 0.98, 0.3)


def family(network: Network) -> dict[str, Network]:
    """Variants of `network` by name: `own`, itself, `bare`, without its terms if it has any, and those of `ground`,
    `two-layers` and `direct-heat` that it allows, without terms too."""
    variants, bare = {"own": network}, network.without_terms()
    for name, variant in {
        "bare": bare if network.terms else None,
        "ground": with_ground(bare),
        "two-layers": with_two_layers(bare),
        "direct-heat": with_direct_heat(bare),
    }.items():
        if variant is not None:
            variants[name] = variant
    return variants


def with_ground(network: Network) -> Network | None:
    """`network` with a conductance from its envelope, the heaviest node, to a ground that stays as it is.

    None where it has one, where there is no envelope beside the room, where nothing leads outside, and where the names
    of the ground are taken.
    """
    outside = [
        network.parameter(edge.name) for edge in network.conductances if set(edge.between) & set(network.boundaries)
    ]
    if _taken(network, GROUND, "C_ground", "g_ground") or len(network.nodes) < 2 or not outside:
        return None
    heaviest = max(network.nodes, key=lambda node: _middle(network.parameter(network.capacitances[node])))
    lower = min(parameter.lower for parameter in outside)
    upper = max(parameter.upper for parameter in outside)
    return replace(
        network,
        name=f"{network.name}-ground",
        capacitances={**network.capacitances, GROUND: "C_ground"},
        conductances=(*network.conductances, Conductance("g_ground", (heaviest, GROUND))),
        parameters=(
            *network.parameters,
            Parameter("C_ground", "J/K", _GROUND_CAPACITANCE, _GROUND_CAPACITANCE, _GROUND_CAPACITANCE, free=False),
            Parameter("g_ground", "W/K", lower, upper),
        ),
        initial={**network.initial, GROUND: InitialTemperature(_GROUND_TEMPERATURE, _GROUND_SD)},
    )


def with_two_layers(network: Network) -> Network | None:
    """`network` with its envelope in two layers, the outer of which is tied to the outdoors in its place.

    None without an `envelope`, and where the names of the outer layer are taken.
    """
    skin = envelope(network)
    if _taken(network, OUTER, "C_outer", "g_layers") or skin is None:
        return None
    outdoors = network.boundaries[0]
    outwards = next(edge for edge in network.conductances if set(edge.between) == {skin, outdoors})
    capacitance = network.parameter(network.capacitances[skin])
    touching = [network.parameter(edge.name) for edge in network.conductances if skin in edge.between]
    moved = replace(outwards, between=(OUTER, outdoors))
    return replace(
        network,
        name=f"{network.name}-two-layers",
        capacitances={**network.capacitances, OUTER: "C_outer"},
        conductances=(
            *(moved if edge == outwards else edge for edge in network.conductances),
            Conductance("g_layers", (skin, OUTER)),
        ),
        parameters=(
            *network.parameters,
            Parameter("C_outer", "J/K", capacitance.lower, capacitance.upper),
            Parameter("g_layers", "W/K", min(p.lower for p in touching), max(p.upper for p in touching)),
        ),
        initial={**network.initial, OUTER: InitialTemperature(outdoors, _OUTER_SD)},
    )


def envelope(network: Network) -> str | None:
    """The heaviest unmeasured node with a conductance to the first boundary; None without one."""
    outdoors = next(iter(network.boundaries), "")
    skins = [
        node
        for edge in network.conductances
        for node in edge.between
        if outdoors in edge.between and node in network.nodes and node not in network.measured
    ]
    return max(skins, key=lambda node: _middle(network.parameter(network.capacitances[node])), default=None)


def with_direct_heat(network: Network) -> Network | None:
    """`network` with a learned share of the heating that goes straight into the room, past the heater's mass.

    At its upper end this is a network without a heater node. None unless one known heat flow [W] enters an unmeasured
    node that is tied to a measured one, and where the name of the share is taken.
    """
    if _taken(network, _SHARE.name):
        return None
    for heat in network.heat_inputs:
        alone = sum(other.channel == heat.channel for other in network.heat_inputs) == 1
        rooms = [
            room
            for edge in network.conductances
            for room in edge.between
            if heat.node in edge.between and room in network.measured
        ]
        if alone and heat.node not in network.measured and heat.gain == Gain(1.0) and rooms:
            split = (
                HeatInput(heat.channel, rooms[0], Gain(parameter=_SHARE.name), heat.unit),
                HeatInput(heat.channel, heat.node, Gain(1.0, _SHARE.name, -1.0), heat.unit),
            )
            return replace(
                network,
                name=f"{network.name}-direct-heat",
                heat_inputs=tuple(
                    part for each in network.heat_inputs for part in (split if each == heat else (each,))
                ),
                parameters=(*network.parameters, _SHARE),
            )
    return None


def _taken(network: Network, *names: str) -> bool:
    """Whether a node, channel or parameter of `network` has one of `names`."""
    own = {*network.nodes, *network.inputs, *(parameter.name for parameter in network.parameters)}
    return not own.isdisjoint(names)


def _middle(parameter: Parameter) -> float:
    return parameter.nominal or float((parameter.lower * parameter.upper) ** 0.5)
