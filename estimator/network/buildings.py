"""Facts of public studies about rooms, so that a zone is informed before its first sample: all per m2 of floor area.

They move the typical values of the envelope of a generic network, and narrow its prior. Nothing here is certain of one
room: `SPREAD` is a factor of 2, and a floor area that nobody knows adds as much.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from math import hypot
from typing import NamedTuple

from estimator.network.boxes import TYPICAL_AREA
from estimator.network.network import Network

SPREAD = 0.7
"""Standard deviation of the logarithm of a fact for one room: rooms of a class differ by a factor of 2."""
_AREA_SPREAD = 0.7
"""The same of the floor area of a zone, where nobody knows it: a room of 35 m2 to a house of 140 m2."""

CONSTRUCTIONS: Mapping[str, float] = {
    "very-light": 8.0e4,
    "light": 1.1e5,
    "medium": 1.65e5,
    "heavy": 2.6e5,
    "very-heavy": 3.7e5,
}
"""Heat capacity [J/(K m2)] that takes part in a day: ISO 13790:2008, table 12, the classes also of EN ISO 52016-1."""


class Envelope(NamedTuple):
    """Heat loss [W/(K m2)] of a detached house from the year `since` on: through walls, roof and floor, and through
    windows and doors."""

    since: int
    opaque: float
    glazed: float


AGES: Sequence[Envelope] = (
    Envelope(0, 3.3, 0.57),
    Envelope(1969, 2.3, 0.59),
    Envelope(1979, 1.3, 0.62),
    Envelope(1995, 1.1, 0.54),
    Envelope(2002, 0.74, 0.30),
    Envelope(2016, 0.49, 0.27),
)
"""TABULA (IEE/08/495), German example houses DE.N.SFH.03 to DE.N.SFH.12 as built; the first class and that of 1979 are
means of three and of two of its own. The walls of British houses have the same course: 1.6 to 2.1 W/(m2 K) before 1976,
then 1.0, .6 from 1983, .45, .35 and .3 from 2007 (RdSAP, table S6)."""

_AIR = 0.5
"""Heat loss [W/(K m2)] to the air that is exchanged: .6 changes an hour, as in TABULA, of 2.5 m by .34 W h/(m3 K)."""
_OUTER_SURFACE = 0.6
"""Of a room over that of a detached house, per m2 of floor: half-way on a logarithmic scale to a flat amid others."""


class Gains(NamedTuple):
    """Heat of people, appliances and light [W/m2] at 0, 3, ... 21 h of local time: on working days, and how much more
    on others."""

    workdays: tuple[float, ...]
    weekend: tuple[float, ...] = (0.0,) * 8


USES: Mapping[str, Gains] = {
    "dwelling": Gains((4.0, 4.0, 4.0, 4.5, 4.5, 4.5, 10.5, 10.5)),
    "living": Gains((2.0, 2.0, 2.0, 8.0, 8.0, 8.0, 20.0, 20.0)),
    "bedroom": Gains((6.0, 6.0, 6.0, 1.0, 1.0, 1.0, 1.0, 1.0)),
    "office": Gains((2.0, 2.0, 2.0, 12.0, 12.0, 12.0, 2.0, 2.0), (0.0, 0.0, 0.0, -10.0, -10.0, -10.0, 0.0, 0.0)),
    "school": Gains((0.0, 0.0, 0.0, 17.0, 17.0, 8.0, 0.0, 0.0), (0.0, 0.0, 0.0, -17.0, -17.0, -8.0, 0.0, 0.0)),
}
"""`living` (with the kitchen), `bedroom` and their mean `dwelling`: ISO 13790:2008, table G.8. `office`: half-way
between its table G.9 (20 W/m2 from 7 to 17 h, 2 otherwise) and DIN V 18599-10 (72 W h/m2 a day without light).
`school`: a classroom of DIN V 18599-10, 120 W h/m2 from 8 to 15 h."""


class Building(NamedTuple):
    """What somebody knows of a zone on its first day; None for what is not known."""

    construction: str | None = None
    """One of CONSTRUCTIONS."""
    built: int | None = None
    """Year, also that of the last insulation."""
    use: str | None = None
    """One of USES."""

    def over(self, other: Building) -> Building:
        """This, with what `other` knows beyond it."""
        return other._replace(**{name: own for name, own in self._asdict().items() if own is not None})


NOTHING_KNOWN = Building()


def has_envelope(network: Network) -> bool:
    """Whether `network` has the envelope of the generic ones, which construction and age speak of."""
    return {"C_e", "g_ie", "g_e_out"} <= {parameter.name for parameter in network.free}


def informed(network: Network, building: Building, floor_area: float | None, known: Collection[str] = ()) -> Network:
    """`network`, one that `has_envelope`, with the prior of its envelope as the facts about `building` have it.

    `floor_area` [m2]; None: it is not known. A value beyond the bounds of its parameter counts as the bound. What is
    `known` better, parameters by name, stays.
    """
    area = TYPICAL_AREA if floor_area is None else floor_area
    spread = SPREAD if floor_area is not None else hypot(SPREAD, _AREA_SPREAD)
    facts: dict[str, float] = {}
    if building.construction is not None:
        facts["C_e"] = CONSTRUCTIONS[building.construction]
    if building.built is not None:
        facts |= _losses(network, AGES[bisect_right(AGES, building.built, key=lambda age: age.since) - 1], area)
    parameters = tuple(
        replace(p, typical=min(max(facts[p.name] * area, p.lower), p.upper), spread=spread)
        if p.free and p.name in facts and p.name not in known
        else p
        for p in network.parameters
    )
    return replace(network, parameters=parameters)


def _losses(network: Network, age: Envelope, area: float) -> dict[str, float]:
    """Conductances [W/(K m2)] from the envelope, and directly, to the outdoors."""
    outer, direct = _OUTER_SURFACE * age.opaque, age.glazed + _AIR
    if not any(parameter.name == "g_i_out" for parameter in network.parameters):
        outer, direct = outer + direct, 0.0
    inner = network.parameter("g_ie")
    # In series with what lies between the room and its envelope.
    within = (inner.typical or (inner.lower * inner.upper) ** 0.5) / area
    facts = {"g_e_out": 1.0 / max(1.0 / outer - 1.0 / within, 1e-9)}
    return facts | ({"g_i_out": direct} if direct else {})
