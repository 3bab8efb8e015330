"""Networks that come with Thermogate: the paper's building and zone, its candidates M1-M8, and the common small ones.

`network(name)` gives one, validated. Bounds and nominal values: building 67 from the public grey-brick buildings set
(Leprince et al. 2022, MIT) with the box .1 to 3 times the truth; the Ecolar zone from the bounds and least-squares
starting point of the paper's authors; the small generic ones span common dwellings and offices.

The bounds of a preset belong to the state that zones have learned with it, so they do not change. For other buildings,
from a room of 20 m2 to a hall of 2,000 m2, the bounds come from the floor area (`estimator.network.boxes`, with the
reasons): every network but building-67 can take them, and `automatic` has the widest ones.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from estimator.errors import NetworkError
from estimator.network.boxes import WIDEST, box, boxed, is_generic
from estimator.network.network import Conductance, Gain, HeatInput, InitialTemperature, Network, Parameter

SOLAR_APERTURE = Parameter("A_w", "m2", 0.1, 30.0, nominal=3.0)


def network(name: str) -> Network:
    """The preset called `name`; NetworkError lists the right names otherwise."""
    if name not in PRESETS:
        raise NetworkError(f"unknown network '{name}'; the presets are {', '.join(PRESETS)}")
    return PRESETS[name].validate()


def takes_box(network: Network) -> bool:
    """Whether `network` is a preset, perhaps with changes, whose bounds can come from the floor area."""
    return network.name in PRESETS and is_generic(network)


_Boxes = Mapping[str, tuple[float, float, float]]
"""Bounds and nominal value of each parameter."""

_UNITS = {"C": "J/K", "g": "W/K", "f": "1"}
"""Of a parameter, by the first letter of its name."""


def _preset(
    name: str,
    description: str,
    links: str,
    heat: Sequence[HeatInput],
    boxes: _Boxes,
    initial: Mapping[str, InitialTemperature],
) -> Network:
    """The network of the conductances `links`, which are named after what they tie: "g_wo_out" or "g_ie". Its nodes
    are those that have a capacitance in `boxes`, in that order; the first one is measured."""
    named = {link: link[2:].split("_") if "_" in link[2:] else list(link[2:]) for link in links.split()}
    edges = {link: (f"T_{one}", f"T_{other}") for link, (one, other) in named.items()}
    ends = {end for pair in edges.values() for end in pair}
    capacitances = {f"T_{each[2:]}": each for each in boxes if each[0] == "C" and f"T_{each[2:]}" in ends}
    shares = dict.fromkeys(one.gain.parameter for one in heat if one.gain.parameter is not None)
    return Network(
        name=name,
        capacitances=capacitances,
        boundaries=tuple(boundary for boundary in ("T_out", "T_adj") if boundary in ends),
        conductances=tuple(Conductance(link, pair) for link, pair in edges.items()),
        heat_inputs=tuple(heat),
        parameters=tuple(
            Parameter(each, _UNITS[each[0]], *boxes[each]) for each in (*capacitances.values(), *edges, *shares)
        ),
        measured=tuple(capacitances)[:1],
        initial={node: initial[node] for node in capacitances if node in initial},
        description=description,
    )


_INTO_AIR = (HeatInput("u_heat", "T_air"),)
_INTO_HEATER = (HeatInput("u_heat", "T_h"),)
_HEAT_SPLIT = (
    HeatInput("u_heat", "T_air", Gain(parameter="f_air")),
    HeatInput("u_heat", "T_h", Gain(1.0, "f_air", -1.0)),
)

_BUILDING_67 = {
    "C_i": 9.882534557e6,
    "C_m": 7.116114805e7,
    "C_e": 8.685263812e6,
    "C_h": 3.64320785e5,
    "C_s": 3.83063767e5,
}
_BUILDING_67 |= {"g_im": 1810.0452, "g_ie": 1879.1592, "g_ih": 3706.4304, "g_is": 425.5493, "g_e_out": 140.5464}
"""The truth."""

_ECOLAR_INITIAL = {
    "T_air": InitialTemperature("measured", 0.5),
    "T_wo": InitialTemperature("T_out", 2.0),
    "T_woi": InitialTemperature("measured", 2.0),
    "T_woo": InitialTemperature("T_out", 2.0),
    "T_wi": InitialTemperature("measured", 2.0),
    "T_h": InitialTemperature("measured", 5.0),
}

# C_air from the zone's 182.5 m3 of air; wall-to-boundary conductances from a total of 60 W/K out and 45 W/K adjacent.
_ECOLAR = {
    "C_air": (1.8e4, 8e6, 2.2e5),
    "C_wo": (1e5, 2e7, 4e6),
    "C_woi": (1e5, 2e7, 2e6),
    "C_woo": (1e5, 2e7, 2e6),
    "C_wi": (1e5, 2e7, 3e6),
    "C_h": (1e2, 1e5, 5e4),
    # The authors' boxes of these start at 1 and at 0 W/K; a log-uniform prior needs a positive end.
    "g_air_out": (0.1, 9000.0, 2.0),
    "g_wo_out": (10.0, 9000.0, 60.2),
    "g_air_wo": (1.0, 9000.0, 1600.0),
    # Of an outside wall in two layers.
    "g_woo_out": (10.0, 9000.0, 120.0),
    "g_woi_woo": (10.0, 9000.0, 120.0),
    "g_air_woi": (1.0, 9000.0, 1600.0),
    "g_air_wi": (1.0, 9000.0, 243.0),
    "g_wi_adj": (10.0, 9000.0, 55.2),
    # Without an adjacent-wall node the adjacent room still acts on the zone, through a massless partition.
    "g_air_adj": (1.0, 9000.0, 45.0),
    "g_air_h": (5.0, 5000.0, 300.0),
    "f_air": (0.02, 0.98, 0.3),
}

_M4 = "g_air_out g_wo_out g_air_wo g_air_wi g_wi_adj g_air_h"

_SMALL = {
    "C_i": (1e5, 1e8, 2e6),
    "C_e": (1e6, 1e9, 2e7),
    "C_h": (1e3, 1e7, 2e5),
    "g_ie": (10.0, 1e4, 500.0),
    "g_e_out": (5.0, 5e3, 150.0),
    "g_ih": (5.0, 1e4, 300.0),
    "g_i_out": (1.0, 2e3, 30.0),
}


def _zone(name: str, description: str, links: str, heat: Sequence[HeatInput] = _INTO_HEATER) -> Network:
    return _preset(name, description, links, heat, _ECOLAR, _ECOLAR_INITIAL)


def _small(name: str, description: str, links: str, heat: Sequence[HeatInput] = _INTO_HEATER) -> Network:
    return _preset(name, description, links, heat, _SMALL, {})


PRESETS = {
    preset.name: preset
    for preset in (
        _preset(
            "building-67",
            "the paper's semi-synthetic building (4.2.2): five states, ten parameters",
            "g_im g_ie g_ih g_is g_e_out",
            (*_INTO_HEATER, HeatInput("I_sol", "T_i", Gain(4.542558125), "W/m2")),
            {name: (0.1 * truth, 3.0 * truth, truth) for name, truth in _BUILDING_67.items()},
            {f"T_{part}": InitialTemperature("measured", 0.2) for part in "imehs"},
        ),
        _zone("ecolar-6r4c", "the paper's Ecolar Home zone (4.3.4): four states, ten parameters", _M4),
        _zone("m1", "M1: air and outside wall", "g_air_out g_wo_out g_air_wo g_air_adj", _INTO_AIR),
        _zone("m2", "M2: M1 with a heater node", "g_air_out g_wo_out g_air_wo g_air_adj g_air_h"),
        _zone("m3", "M3: M1 with an adjacent-wall node", "g_air_out g_wo_out g_air_wo g_air_wi g_wi_adj", _INTO_AIR),
        _zone("m4", "M4: air, outside wall, adjacent wall, heater (the Ecolar zone)", _M4),
        _zone("m5", "M5: M4 with the heat split between air and heater", _M4, _HEAT_SPLIT),
        _zone("m6", "M6: M4 without direct air-outdoor conductance", "g_wo_out g_air_wo g_air_wi g_wi_adj g_air_h"),
        _zone(
            "m7",
            "M7: M4 with the outside wall in two layers",
            "g_air_out g_woo_out g_woi_woo g_air_woi g_air_wi g_wi_adj g_air_h",
        ),
        _zone(
            "m8",
            "M8: M7 without direct air-outdoor conductance",
            "g_woo_out g_woi_woo g_air_woi g_air_wi g_wi_adj g_air_h",
        ),
        _small("tite", "TiTe: interior and envelope", "g_ie g_e_out", (HeatInput("u_heat", "T_i"),)),
        _small("titeth", "TiTeTh: interior, envelope, heater", "g_ie g_e_out g_ih"),
        _small("titethria", "TiTeThRia: TiTeTh with direct air-outdoor conductance", "g_ie g_e_out g_ih g_i_out"),
    )
}

AUTO = "auto"
"""The name of the network that follows from the channels of its zone."""

SUN, CLOUDS, NEIGHBOUR = "I_sol", "cloud_cover", "T_adj"
"""The channels of the sun and, without one, of the clouds, and how those of neighbours begin, in the network that
follows from its channels."""


def automatic(channels: Collection[str] = ()) -> Network:
    """The network of a zone that has `channels` and nobody chose one for: TiTeThRia with the widest boxes.

    `I_sol` among the channels adds a solar aperture into the room, otherwise `cloud_cover` an input that dims a clear
    sky; every channel that begins with `T_adj` adds a conductance from the room to that neighbour. The order of the
    channels does not matter.
    """
    neighbours = tuple(sorted(channel for channel in channels if channel.startswith(NEIGHBOUR)))
    edges = tuple(Conductance(f"g_i_{channel.removeprefix('T_')}", ("T_i", channel)) for channel in neighbours)
    base = PRESETS["titethria"]
    network = boxed(
        replace(
            base,
            name=AUTO,
            boundaries=(*base.boundaries, *neighbours),
            conductances=(*base.conductances, *edges),
            parameters=(*base.parameters, *(Parameter(edge.name, "W/K", 1.0, 2e3) for edge in edges)),
            description="from the zone's channels: titethria with wide bounds, sun (I_sol) and neighbours (T_adj...)",
        )
    )
    if SUN in channels:
        return network.with_solar("T_i", box(SOLAR_APERTURE, *WIDEST), SUN)
    clouds = (HeatInput(CLOUDS, "T_i", Gain(0.0), "%"),) if CLOUDS in channels else ()
    return replace(network, heat_inputs=(*network.heat_inputs, *clouds))


PRESETS[AUTO] = automatic()
