"""A small family of networks over the same channels, for a zone whose network nobody has chosen."""

from __future__ import annotations

from dataclasses import replace

from estimator.network.network import Conductance, InitialTemperature, Network, Parameter

GROUND = "T_ground"
_GROUND_CAPACITANCE = 1e12
"""J/K: so large that nothing a zone does changes the temperature of the ground."""
_GROUND_TEMPERATURE, _GROUND_SD = 12.0, 4.0


def family(network: Network) -> dict[str, Network]:
    """Variants of `network` by name, itself first: with a path from its heaviest node to a constant ground.

    All of them have the same inputs and outputs, so that they can stand beside each other in a bank.
    """
    variants = {"own": network}
    if GROUND not in network.nodes and len(network.nodes) > 1:
        variants["ground"] = with_ground(network)
    return variants


def with_ground(network: Network) -> Network:
    """`network` with a conductance from its envelope, the heaviest node, to a ground that stays as it is."""
    heaviest = max(network.nodes, key=lambda node: _middle(network.parameter(network.capacitances[node])))
    outside = [
        network.parameter(edge.name) for edge in network.conductances if set(edge.between) & set(network.boundaries)
    ]
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


def _middle(parameter: Parameter) -> float:
    return parameter.nominal or float((parameter.lower * parameter.upper) ** 0.5)
