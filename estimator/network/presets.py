"""Networks that come with Thermogate: the paper's building and zone, its candidates M1-M8, and the common small ones.

`network(name)` gives one, validated. Bounds and nominal values: building 67 from the public grey-brick buildings set
(Leprince et al. 2022, MIT) with the box .1 to 3 times the truth; the Ecolar zone from the bounds and least-squares
starting point of the paper's authors; the small generic ones span common dwellings and offices.

The bounds of a preset belong to the state that zones have learned with it, so they do not change. For other buildings,
from a room of 20 m2 to a hall of 2,000 m2, the bounds come from the floor area (`estimator.network.boxes`, with the
reasons): every network but building-67 can take them, and `automatic` has the widest ones.
"""

from collections.abc import Callable, Collection
from dataclasses import replace
from functools import partial

from estimator.errors import NetworkError
from estimator.network.boxes import WIDEST, box, boxed, is_generic
from estimator.network.network import Conductance, Gain, HeatInput, InitialTemperature, Network, Parameter

SOLAR_APERTURE = Parameter("A_w", "m2", 0.1, 30.0, nominal=3.0)


def network(name: str) -> Network:
    """The preset called `name`; NetworkError lists the right names otherwise."""
    if name not in PRESETS:
        raise NetworkError(f"unknown network '{name}'; the presets are {', '.join(PRESETS)}")
    return PRESETS[name]().validate()


def takes_box(network: Network) -> bool:
    """Whether `network` is a preset, perhaps with changes, whose bounds can come from the floor area."""
    return network.name in PRESETS and is_generic(network)


def _capacitance(name: str, lower: float, upper: float, nominal: float | None = None) -> Parameter:
    return Parameter(name, "J/K", lower, upper, nominal)


def _conductance(name: str, lower: float, upper: float, nominal: float | None = None) -> Parameter:
    return Parameter(name, "W/K", lower, upper, nominal)


def _around(name: str, unit: str, truth: float) -> Parameter:
    return Parameter(name, unit, 0.1 * truth, 3.0 * truth, truth)


def building_67() -> Network:
    """The 5-state building of paper 4.2.2: T_i, T_m, T_e, T_h, T_s; ten parameters, solar aperture known."""
    truth = {"C_i": 9.882534557e6, "C_m": 7.116114805e7, "C_e": 8.685263812e6, "C_h": 3.64320785e5, "C_s": 3.83063767e5}
    links = {"g_im": 1810.0452, "g_ie": 1879.1592, "g_ih": 3706.4304, "g_is": 425.5493, "g_e_out": 140.5464}
    return Network(
        name="building-67",
        capacitances={f"T_{part}": f"C_{part}" for part in "imehs"},
        boundaries=("T_out",),
        conductances=(
            Conductance("g_im", ("T_i", "T_m")),
            Conductance("g_ie", ("T_i", "T_e")),
            Conductance("g_ih", ("T_i", "T_h")),
            Conductance("g_is", ("T_i", "T_s")),
            Conductance("g_e_out", ("T_e", "T_out")),
        ),
        heat_inputs=(HeatInput("u_heat", "T_h"), HeatInput("I_sol", "T_i", Gain(4.542558125), "W/m2")),
        parameters=(
            *(_around(name, "J/K", value) for name, value in truth.items()),
            *(_around(name, "W/K", value) for name, value in links.items()),
        ),
        measured=("T_i",),
        initial={f"T_{part}": InitialTemperature("measured", 0.2) for part in "imehs"},
        description="the paper's semi-synthetic building (4.2.2): five states, ten parameters",
    )


_ECOLAR_INITIAL = {
    "T_air": InitialTemperature("measured", 0.5),
    "T_wo": InitialTemperature("T_out", 2.0),
    "T_wi": InitialTemperature("measured", 2.0),
    "T_h": InitialTemperature("measured", 5.0),
}

# C_air from the zone's 182.5 m3 of air; wall-to-boundary conductances from a total of 60 W/K out and 45 W/K adjacent.
_ECOLAR_PARAMETERS = {
    "C_air": _capacitance("C_air", 1.8e4, 8e6, 2.2e5),
    "C_wo": _capacitance("C_wo", 1e5, 2e7, 4e6),
    "C_wi": _capacitance("C_wi", 1e5, 2e7, 3e6),
    "C_h": _capacitance("C_h", 1e2, 1e5, 5e4),
    # The authors' boxes of these start at 1 and at 0 W/K; a log-uniform prior needs a positive end.
    "g_air_out": _conductance("g_air_out", 0.1, 9000.0, 2.0),
    "g_wo_out": _conductance("g_wo_out", 10.0, 9000.0, 60.2),
    "g_air_wo": _conductance("g_air_wo", 1.0, 9000.0, 1600.0),
    "g_air_wi": _conductance("g_air_wi", 1.0, 9000.0, 243.0),
    "g_wi_adj": _conductance("g_wi_adj", 10.0, 9000.0, 55.2),
    "g_air_h": _conductance("g_air_h", 5.0, 5000.0, 300.0),
}


def ecolar() -> Network:
    """The Ecolar Home zone of paper 4.3.4 (6R4C): air, outside wall, adjacent wall, heater; ten parameters."""
    return Network(
        name="ecolar-6r4c",
        capacitances={"T_air": "C_air", "T_wo": "C_wo", "T_wi": "C_wi", "T_h": "C_h"},
        boundaries=("T_out", "T_adj"),
        conductances=(
            Conductance("g_air_out", ("T_air", "T_out")),
            Conductance("g_wo_out", ("T_wo", "T_out")),
            Conductance("g_air_wo", ("T_air", "T_wo")),
            Conductance("g_air_wi", ("T_air", "T_wi")),
            Conductance("g_wi_adj", ("T_wi", "T_adj")),
            Conductance("g_air_h", ("T_air", "T_h")),
        ),
        heat_inputs=(HeatInput("u_heat", "T_h"),),
        parameters=tuple(_ECOLAR_PARAMETERS.values()),
        measured=("T_air",),
        initial=_ECOLAR_INITIAL,
        description="the paper's Ecolar Home zone (4.3.4): four states, ten parameters",
    )


def _zone(
    name: str, description: str, edges: dict[str, tuple[str, str]], heat: tuple[HeatInput, ...], *extra: Parameter
) -> Network:
    """An Ecolar candidate whose nodes follow from its edges; parameters not in the Ecolar table come as `extra`."""
    known = _ECOLAR_PARAMETERS | {parameter.name: parameter for parameter in extra}
    boundaries = tuple(b for b in ("T_out", "T_adj") if any(b in pair for pair in edges.values()))
    order = ("T_air", "T_wo", "T_woi", "T_woo", "T_wi", "T_h")
    nodes = [node for node in order if any(node in pair for pair in edges.values())]
    capacitances = {node: node.replace("T_", "C_") for node in nodes}
    initial = _ECOLAR_INITIAL | {
        "T_woi": InitialTemperature("measured", 2.0),
        "T_woo": InitialTemperature("T_out", 2.0),
    }
    return Network(
        name=name,
        capacitances=capacitances,
        boundaries=boundaries,
        conductances=tuple(Conductance(edge, pair) for edge, pair in edges.items()),
        heat_inputs=heat,
        parameters=tuple(known[parameter] for parameter in (*capacitances.values(), *edges))
        + tuple(p for p in extra if p.name not in (*capacitances.values(), *edges)),
        measured=("T_air",),
        initial={node: initial[node] for node in nodes},
        description=description,
    )


_INFILTRATION = {"g_air_out": ("T_air", "T_out")}
_OUTSIDE_WALL = {"g_wo_out": ("T_wo", "T_out"), "g_air_wo": ("T_air", "T_wo")}
_ADJACENT_WALL = {"g_air_wi": ("T_air", "T_wi"), "g_wi_adj": ("T_wi", "T_adj")}
# Without an adjacent-wall node the adjacent room still acts on the zone, through a massless partition.
_PARTITION = {"g_air_adj": ("T_air", "T_adj")}
_PARTITION_PARAMETER = _conductance("g_air_adj", 1.0, 9000.0, 45.0)
_HEATER = {"g_air_h": ("T_air", "T_h")}
_SPLIT_WALL = {"g_woo_out": ("T_woo", "T_out"), "g_woi_woo": ("T_woi", "T_woo"), "g_air_woi": ("T_air", "T_woi")}
_SPLIT_WALL_PARAMETERS = (
    _capacitance("C_woi", 1e5, 2e7, 2e6),
    _capacitance("C_woo", 1e5, 2e7, 2e6),
    _conductance("g_woo_out", 10.0, 9000.0, 120.0),
    _conductance("g_woi_woo", 10.0, 9000.0, 120.0),
    _conductance("g_air_woi", 1.0, 9000.0, 1600.0),
)
_INTO_AIR = (HeatInput("u_heat", "T_air"),)
_INTO_HEATER = (HeatInput("u_heat", "T_h"),)
_HEAT_SPLIT = (
    HeatInput("u_heat", "T_air", Gain(parameter="f_air")),
    HeatInput("u_heat", "T_h", Gain(1.0, "f_air", -1.0)),
)


def m4() -> Network:
    return replace(ecolar(), name="m4", description="M4: air, outside wall, adjacent wall, heater (the Ecolar zone)")


_WALLS = _OUTSIDE_WALL | _ADJACENT_WALL
_SPLIT_WALLS = _SPLIT_WALL | _ADJACENT_WALL
_CANDIDATES: dict[str, Callable[[], Network]] = {
    "m1": partial(
        _zone, "m1", "M1: air and outside wall",
        _INFILTRATION | _OUTSIDE_WALL | _PARTITION, _INTO_AIR, _PARTITION_PARAMETER,
    ),
    "m2": partial(
        _zone, "m2", "M2: M1 with a heater node",
        _INFILTRATION | _OUTSIDE_WALL | _PARTITION | _HEATER, _INTO_HEATER, _PARTITION_PARAMETER,
    ),
    "m3": partial(_zone, "m3", "M3: M1 with an adjacent-wall node", _INFILTRATION | _WALLS, _INTO_AIR),
    "m4": m4,
    "m5": partial(
        _zone, "m5", "M5: M4 with the heat split between air and heater",
        _INFILTRATION | _WALLS | _HEATER, _HEAT_SPLIT, Parameter("f_air", "1", 0.02, 0.98, 0.3),
    ),
    "m6": partial(_zone, "m6", "M6: M4 without direct air-outdoor conductance", _WALLS | _HEATER, _INTO_HEATER),
    "m7": partial(
        _zone, "m7", "M7: M4 with the outside wall in two layers",
        _INFILTRATION | _SPLIT_WALLS | _HEATER, _INTO_HEATER, *_SPLIT_WALL_PARAMETERS,
    ),
    "m8": partial(
        _zone, "m8", "M8: M7 without direct air-outdoor conductance",
        _SPLIT_WALLS | _HEATER, _INTO_HEATER, *_SPLIT_WALL_PARAMETERS,
    ),
}  # fmt: skip
"""The paper's candidates for the Ecolar zone."""


_SMALL = {
    "T_i": _capacitance("C_i", 1e5, 1e8, 2e6),
    "T_e": _capacitance("C_e", 1e6, 1e9, 2e7),
    "T_h": _capacitance("C_h", 1e3, 1e7, 2e5),
    "g_ie": _conductance("g_ie", 10.0, 1e4, 500.0),
    "g_e_out": _conductance("g_e_out", 5.0, 5e3, 150.0),
    "g_ih": _conductance("g_ih", 5.0, 1e4, 300.0),
    "g_i_out": _conductance("g_i_out", 1.0, 2e3, 30.0),
}


def _small(name: str, description: str, nodes: tuple[str, ...], edges: dict[str, tuple[str, str]]) -> Network:
    return Network(
        name=name,
        capacitances={node: node.replace("T_", "C_") for node in nodes},
        boundaries=("T_out",),
        conductances=tuple(Conductance(edge, pair) for edge, pair in edges.items()),
        heat_inputs=(HeatInput("u_heat", "T_h" if "T_h" in nodes else "T_i"),),
        parameters=tuple(_SMALL[key] for key in (*nodes, *edges)),
        measured=("T_i",),
        description=description,
    )


_ENVELOPE = {"g_ie": ("T_i", "T_e"), "g_e_out": ("T_e", "T_out")}


def tite() -> Network:
    return _small("tite", "TiTe: interior and envelope", ("T_i", "T_e"), _ENVELOPE)


def titeth() -> Network:
    edges = _ENVELOPE | {"g_ih": ("T_i", "T_h")}
    return _small("titeth", "TiTeTh: interior, envelope, heater", ("T_i", "T_e", "T_h"), edges)


def titethria() -> Network:
    edges = _ENVELOPE | {"g_ih": ("T_i", "T_h"), "g_i_out": ("T_i", "T_out")}
    return _small("titethria", "TiTeThRia: TiTeTh with direct air-outdoor conductance", ("T_i", "T_e", "T_h"), edges)


AUTO = "auto"
"""The name of the network that follows from the channels of its zone."""

SUN, NEIGHBOUR = "I_sol", "T_adj"
"""The channel of the sun, and how the channels of neighbours begin, in the network that follows from its channels."""


def automatic(channels: Collection[str] = ()) -> Network:
    """The network of a zone that has `channels` and nobody chose one for: TiTeThRia with the widest boxes.

    `I_sol` among the channels adds a solar aperture into the room, and every channel that begins with `T_adj` a
    conductance from the room to that neighbour. The order of the channels does not matter.
    """
    neighbours = tuple(sorted(channel for channel in channels if channel.startswith(NEIGHBOUR)))
    edges = tuple(Conductance(f"g_i_{channel.removeprefix('T_')}", ("T_i", channel)) for channel in neighbours)
    base = titethria()
    network = boxed(
        replace(
            base,
            name=AUTO,
            boundaries=(*base.boundaries, *neighbours),
            conductances=(*base.conductances, *edges),
            parameters=(*base.parameters, *(_conductance(edge.name, 1.0, 2e3) for edge in edges)),
            description="from the zone's channels: titethria with wide bounds, sun (I_sol) and neighbours (T_adj...)",
        )
    )
    return network.with_solar("T_i", box(SOLAR_APERTURE, *WIDEST), SUN) if SUN in channels else network


PRESETS: dict[str, Callable[[], Network]] = {
    "building-67": building_67,
    "ecolar-6r4c": ecolar,
    **_CANDIDATES,
    "tite": tite,
    "titeth": titeth,
    "titethria": titethria,
    AUTO: automatic,
}
