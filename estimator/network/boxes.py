"""Boxes of the generic networks from the floor area.

A parameter of a building that is not a conductance of one joint grows with the building, and the floor area is the one
size that everybody knows. So each parameter has a range per m2 of floor area that spans building types, and its box for
a floor area A is that range times A. If A is only known to lie in a range, the box takes the lower end from the
smallest and the upper end from the largest A; from 20 m2 (a room) to 2,000 m2 (a hall) that is the widest box.

Reasons, per m2 of floor:

- Interior (C_i, C_air), 3 to 200 kJ/K: the air alone has 3 (2.5 m high, 1.2 kJ/(m3 K)) to 10 kJ/K (a hall of 8 m); with
  furniture and the first layers of plaster and screed, ISO 13790 counts 80 (very light) to 165 kJ/K (medium).
- Envelope and structure (C_e, walls), 20 to 1,000 kJ/K: lightweight panels to 370 kJ/K (very heavy, ISO 13790), and
  20 cm of concrete above and below with 480 kJ/K each. A wall in two layers, or to one neighbour, has a share: from 10.
- Heater (C_h), .05 to 150 kJ/K: an electric convector, a water-filled radiator (2 kJ/K at 100 W/m2), 6 cm of screed
  with pipes.
- Room to structure (g_ie, g_air_wo, g_air_wi), .5 to 40 W/K: 2 to 4 m2 of surface per m2 of floor times 2.5 to 8
  W/(m2 K), less where lining or carpet is in between. Between two layers of a wall, .1 to 40 W/K.
- Structure to outdoors (g_e_out, g_wo_out), .1 to 10 W/K: the whole fabric has .3 (passive house) to 5 W/K (a small
  or poor building with much wall per floor), of which this may be any part, in series with g_ie.
- Directly to outdoors (g_i_out, g_air_out), .05 to 5 W/K: windows and leaks; 1 air change per hour is .8 W/K at 2.5 m
  and 2.7 W/K at 8 m.
- Heater to room (g_ih, g_air_h), .2 to 30 W/K: 100 W from a radiator 50 K warmer is 2 W/K, a heated floor has 6 to 11
  W/K, a fan coil up to 30.
- To a neighbour (g_i_adj, g_wi_adj), .05 to 10 W/K: .2 to 2 m2 of partition times .5 to 3 W/(m2 K), and an open door.
- Ground (g_ground), .02 to 5 W/K: an insulated slab to a bare one with its edges.
- Solar aperture (A_w), .002 to .3 m2: of horizontal irradiance; windows of 2 to 60 % of the floor, a transmittance of
  .2 to .6, and shade. A glazed hall of 2,000 m2 has up to 600 m2.

A share of heat (f_air, or of a meter of several zones) does not grow with the building and keeps its bounds.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import sqrt

from estimator.errors import NetworkError
from estimator.network.network import SHARE, Network, Parameter

WIDEST = (20.0, 2000.0)
"""m2: a room and a hall, the floor areas between which the widest box holds."""

TYPICAL_AREA = 70.0
"""m2: of a zone whose floor area nobody knows, a flat or a storey of a house."""


PER_AREA: Mapping[str, tuple[float, float]] = {
    name: (lower, upper)
    for names, lower, upper in (
        ("C_i C_air", 3e3, 2e5),
        ("C_e", 2e4, 1e6),
        ("C_wo C_woi C_woo C_wi", 1e4, 1e6),
        ("C_h", 50.0, 1.5e5),
        ("g_ie g_air_wo g_air_woi g_air_wi", 0.5, 40.0),
        ("g_woi_woo", 0.1, 40.0),
        ("g_e_out g_wo_out g_woo_out", 0.1, 10.0),
        ("g_i_out g_air_out", 0.05, 5.0),
        ("g_ih g_air_h", 0.2, 30.0),
        ("g_i_adj g_wi_adj g_air_adj", 0.05, 10.0),
        ("g_ground", 0.02, 5.0),
        ("A_w", 0.002, 0.3),
    )
    for name in names.split()
}
"""Range of a parameter per m2 of floor area, in J/K, W/K or m2, by its name in the generic networks. The paths to
neighbours of `auto`, g_i_adj..., share one range."""

_NEIGHBOURS = "g_i_adj"
_SHARES = ("f_air", "f_direct", SHARE)
"""How the names of shares of heat begin."""


def is_generic(network: Network) -> bool:
    """Whether every free parameter of `network` has a range per m2 of floor area."""
    return all(each.name in PER_AREA or each.name.startswith((*_SHARES, _NEIGHBOURS)) for each in network.free)


def box(parameter: Parameter, smallest: float, largest: float) -> Parameter:
    """`parameter` of a generic network with the bounds for a floor area between `smallest` and `largest` [m2].

    Its typical value is the middle of the range per m2 on a logarithmic scale, times the floor area. A nominal value
    outside the bounds is dropped. NetworkError for a parameter that has no range per m2.
    """
    name = parameter.name
    if name.startswith(_SHARES):
        return parameter
    per_area = PER_AREA.get(_NEIGHBOURS if name.startswith(_NEIGHBOURS) else name)
    if per_area is None:
        raise NetworkError(f"parameter '{name}' has no range per m2 of floor area")
    least, most = per_area
    lower, upper = least * smallest, most * largest
    inside = parameter.nominal is not None and lower <= parameter.nominal <= upper
    nominal = parameter.nominal if inside else None
    area = TYPICAL_AREA if (smallest, largest) == WIDEST else sqrt(smallest * largest)
    return replace(parameter, lower=lower, upper=upper, nominal=nominal, typical=sqrt(least * most) * area)


def boxed(network: Network, smallest: float = WIDEST[0], largest: float = WIDEST[1]) -> Network:
    """`network` with the boxes for a floor area between `smallest` and `largest` [m2]; without them the widest ones.

    Raises NetworkError if the network is not a generic one: its bounds then belong to one building.
    """
    parameters = tuple(box(each, smallest, largest) if each.free else each for each in network.parameters)
    return replace(network, parameters=parameters)
