"""The paper's candidate networks M1-M8 (Table 2), for the Ecolar zone and for the channels of any other."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

from estimator.network import presets
from estimator.network.network import Conductance, HeatInput, Network, Parameter

SOLAR = "I_sol"
"""Channel of the regional irradiance that goes with an Ecolar recording."""
IRRADIANCE = "W/m2"
OWN = "own"
"""Label of the network that the user has."""


class Candidate(NamedTuple):
    """A network in the comparison: `label` as in Table 2, and whether the sun is one of its inputs."""

    label: str
    network: Network
    solar: bool

    @property
    def name(self) -> str:
        return f"{self.label} with sun" if self.solar else self.label


class _Box(NamedTuple):
    """Unit and bounds of a parameter of a candidate for any building: from a small room to an office floor."""

    unit: str
    lower: float
    upper: float


_AIR, _WALL, _HEATER = _Box("J/K", 1e4, 1e8), _Box("J/K", 1e5, 1e9), _Box("J/K", 1e2, 1e7)
_LINK, _SHARE, _APERTURE = _Box("W/K", 0.1, 1e4), _Box("1", 0.02, 0.98), _Box("m2", 0.01, 100.0)


_ADJACENT_WALL, _HEATER_BODY = "T_wi", "T_h"
_LABELS = ("M1", "M2", "M3", "M4", "M5", "M6", "M7", "M8")


def ecolar_candidates(irradiance: bool) -> list[Candidate]:
    """The presets m1 to m8, each also with regional irradiance where there is any."""
    plain = {label: presets.network(label.lower()) for label in _LABELS}
    found = []
    for label, network in plain.items():
        found.append(Candidate(label, network, False))
        if irradiance:
            lit = network.with_solar(network.measured[0], presets.SOLAR_APERTURE, SOLAR).validate()
            found.append(Candidate(label, lit, True))
    return found


def candidates_for(own: Network) -> list[Candidate]:
    """`own`, and M1-M8 as far as its channels allow, each without and, where there is irradiance, with it, of the first
    measured node. Boundaries but the outdoor one are adjacent rooms, the first heat input in W is the heater, the
    others enter the air with their own gain. What would be the same network appears once."""
    suns = [channel for channel in own.heat_channels if own.channel_unit(channel) == IRRADIANCE]
    found = [Candidate(OWN, without_sun(own), False)]
    if suns:
        found.append(Candidate(OWN, own, True))
    known: set[tuple[object, ...]] = set()
    for label in _LABELS:
        network = _adapted(own, presets.network(label.lower()))
        shape = (tuple(network.capacitances), tuple(network.conductances), tuple(network.heat_inputs))
        if shape not in known:
            known.add(shape)
            found.append(Candidate(label, network.validate(), False))
            if suns:
                found.append(Candidate(label, _sunlit(network, suns).validate(), True))
    return found


def without_sun(network: Network) -> Network:
    """`network` without its irradiance inputs and the parameters that only they use."""
    heat = tuple(h for h in network.heat_inputs if h.unit != IRRADIANCE)
    used = {*network.capacitances.values(), *(edge.name for edge in network.conductances)}
    used |= {h.gain.parameter for h in heat if h.gain.parameter is not None}
    kept = tuple(parameter for parameter in network.parameters if parameter.name in used)
    return replace(network, heat_inputs=heat, parameters=kept)


def _adapted(own: Network, preset: Network) -> Network:
    """`preset`, a candidate for Ecolar, for the channels of `own`: an adjacent wall for every adjacent room, none of
    it without one, and no heater without a heat input."""
    air = own.measured[0]
    outdoors, *rooms = sorted(own.boundaries, key=_how_far_out)
    watts = [channel for channel in own.heat_channels if own.channel_unit(channel) == "W"]
    named = {"T_air": [air], "T_out": [outdoors], "T_adj": rooms}
    taken = [air, *own.boundaries, *own.heat_channels]
    boxes, initial = {air: _AIR}, {air: preset.initial_temperature("T_air")}
    for node in preset.nodes[1:]:
        count = len(rooms) if node == _ADJACENT_WALL else len(watts[:1]) if node == _HEATER_BODY else 1
        named[node] = []
        for _ in range(count):
            name = _fresh(node, (*taken, *boxes))
            named[node].append(name)
            boxes[name] = _HEATER if node == _HEATER_BODY else _WALL
            rule = preset.initial_temperature(node)
            initial[name] = replace(rule, source=outdoors) if rule.source == "T_out" else rule
    conductances = []
    for edge in preset.conductances:
        ones, others = (named[end] for end in edge.between)
        pairs = zip(ones, others, strict=True) if len(ones) == len(others) else product(ones, others)
        conductances += [Conductance(f"g_{_short(a)}_{_short(b)}", (a, b)) for a, b in pairs]
    heat = _into_air(own, air, watts[:1])
    parameters = [own.parameter(h.gain.parameter) for h in heat if h.gain.parameter is not None]
    shared = [h.gain.parameter for h in preset.heat_inputs if h.gain.parameter is not None]
    share = _fresh("f_air", [parameter.name for parameter in parameters])
    if watts:
        parameters += [Parameter(share, *_SHARE)] if shared else []
        panel = [
            replace(
                h, channel=watts[0], node=named[h.node][0], gain=replace(h.gain, parameter=h.gain.parameter and share)
            )
            for h in preset.heat_inputs
        ]
        heat = (*panel, *heat)
    capacitances = {node: f"C_{_short(node)}" for node in boxes}
    return Network(
        name=preset.name,
        capacitances=capacitances,
        boundaries=own.boundaries,
        conductances=tuple(conductances),
        heat_inputs=heat,
        parameters=(
            *(Parameter(capacitances[node], *box) for node, box in boxes.items()),
            *(Parameter(edge.name, *_LINK) for edge in conductances),
            *dict.fromkeys(parameters),
        ),
        measured=(air,),
        initial=initial,
    )


def _into_air(own: Network, air: str, without: Sequence[str]) -> tuple[HeatInput, ...]:
    """The other heat inputs of `own` but the sun, each once, with the gain that it has there."""
    first: dict[str, HeatInput] = {}
    for heat in own.heat_inputs:
        if heat.channel not in without and heat.unit != IRRADIANCE:
            first.setdefault(heat.channel, replace(heat, node=air))
    return tuple(first.values())


def _sunlit(network: Network, suns: Iterable[str]) -> Network:
    """`network` with an aperture into the air for each irradiance channel."""
    for channel in suns:
        name = _fresh("A_w", [parameter.name for parameter in network.parameters])
        network = network.with_solar(network.measured[0], Parameter(name, *_APERTURE), channel)
    return network


def _how_far_out(boundary: str) -> tuple[bool, bool]:
    """Smallest for the outdoor boundary, by its name: "T_next" has an "ext" in it too."""
    return boundary != "T_out", not any(word in boundary.lower() for word in ("out", "ext", "amb"))


def _short(node: str) -> str:
    return node.removeprefix("T_")


def _fresh(wanted: str, taken: Iterable[str]) -> str:
    """`wanted`, or with a number behind it where something is already called so."""
    names = set(taken)
    return next(name for name in (wanted, *(f"{wanted}{n}" for n in range(2, 1000))) if name not in names)
