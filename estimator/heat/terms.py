"""Which terms of known heat a network gets: the sun by facade or by hour, and the habits of people.

The priors are those of a house of 70 m2 a floor, and scale with the floor area where it is known. Heat of people,
appliances and light is about 3 +- 1.5 W/m2 (ISO 13790 has 1 to 6 W/m2 in homes). An aperture is the area of windows
times their transmittance and what shades leave of it.
"""

from dataclasses import replace

from estimator.errors import NetworkError
from estimator.heat.sun import Location
from estimator.network.boxes import TYPICAL_AREA
from estimator.network.buildings import USES
from estimator.network.family import envelope
from estimator.network.network import Network
from estimator.network.terms import HeatTerm

SUN_KINDS = ("facades", "hours", "clear-sky")
HABIT_HOURS = tuple(range(0, 24, 3))
"""h of local time at which the eight periodic hats of a day have their peaks."""
SUN_HOURS = (6, 9, 12, 15, 18)
"""h of local standard time; before the first and after the last the hats go on."""

DIFFUSE, HORIZONTAL = "diffuse", "horizontal"
CLEAR, HABIT = "clear_", "habit_"
"""Before the names of series: what they would be if the sky were clear, or had the clouds that a channel tells; heat by
the hour, of people."""

_APERTURE, _APERTURE_SD, _APERTURE_WALK = 1.0, 2.0, 0.03
_HABIT, _HABIT_SD, _DIFFERENCE_SD, _HABIT_WALK = 200.0, 80.0, 100.0, 5.0
_OF_USE_SD = 0.5
"""Standard deviation of the heat of a known use, as a share of it, where that is more."""


def sun_channel(network: Network) -> str | None:
    """The heat input with the horizontal irradiance [W/m2]; None without one."""
    return next((heat.channel for heat in network.heat_inputs if heat.unit == "W/m2"), None)


def with_known_heat(
    network: Network,
    *,
    habits: bool = False,
    sun: str | None = None,
    location: Location | None = None,
    floor_area: float | None = None,
    use: str | None = None,
) -> Network:
    """`network` with terms for `habits` and for the `sun`, by "facades" or "hours", or by facades under a "clear-sky".

    Facades and a clear sky need a `location`; without a clear sky the sun needs a heat input in W/m2. NetworkError with
    one sentence where that is missing. `use` is one of USES, whose habits are then expected.
    """
    scale = 1.0 if floor_area is None else floor_area / TYPICAL_AREA
    terms: list[HeatTerm] = []
    for node in network.measured:
        room = "" if len(network.measured) == 1 else f"_{node}"
        if sun is not None:
            terms += _sun_terms(network, sun, location, node, room, scale)
        if habits:
            terms += _habit_terms(node, room, scale, use)
    skin = envelope(network)
    if sun is not None and skin is not None:
        clear = CLEAR if sun == "clear-sky" else ""
        terms.append(_aperture("sun_envelope", skin, clear + HORIZONTAL, scale))
    return replace(network, terms=tuple(terms)).validate()


def _sun_terms(
    network: Network, kind: str, location: Location | None, node: str, room: str, scale: float
) -> list[HeatTerm]:
    if kind not in SUN_KINDS:
        raise NetworkError(f'sun = "{kind}" must be "facades", "hours" or "clear-sky"')
    if sun_channel(network) is None and kind != "clear-sky":
        raise NetworkError(
            f'sun = "{kind}" needs the horizontal irradiance; add a heat input in W/m2, such as the channel I_sol, or '
            'write sun = "clear-sky"'
        )
    if kind == "hours":
        return [_aperture(f"sun_{hour:02}{room}", node, f"sun_{hour:02}", scale) for hour in SUN_HOURS]
    if location is None:
        otherwise = '; without them write sun = "hours"' if kind == "facades" else ""
        raise NetworkError(f'sun = "{kind}" needs the latitude and longitude of the site{otherwise}')
    faces = ("east", "south" if location.latitude >= 0.0 else "north", "west")
    clear = CLEAR if kind == "clear-sky" else ""
    return [_aperture(f"sun_{face}{room}", node, clear + face, scale) for face in (*faces, DIFFUSE)]


def _aperture(name: str, node: str, series: str, scale: float) -> HeatTerm:
    return HeatTerm(name, node, series, "m2", _APERTURE * scale, _APERTURE_SD * scale, _APERTURE_WALK * scale, 0.0)


def _habit_terms(node: str, room: str, scale: float, use: str | None) -> list[HeatTerm]:
    workdays, weekend = [(_HABIT, _HABIT_SD)] * len(HABIT_HOURS), [(0.0, _DIFFERENCE_SD)] * len(HABIT_HOURS)
    if use is not None:
        workdays, weekend = (
            [(TYPICAL_AREA * heat, max(sd, _OF_USE_SD * TYPICAL_AREA * abs(heat))) for heat in by_hour]
            for by_hour, sd in zip(USES[use], (_HABIT_SD, _DIFFERENCE_SD), strict=True)
        )
    return [
        HeatTerm(f"{name}{hour:02}{room}", node, f"{name}{hour:02}", "W", mean * scale, sd * scale, _HABIT_WALK * scale)
        for name, beliefs in (("habit_", workdays), ("habit_weekend_", weekend))
        for hour, (mean, sd) in zip(HABIT_HOURS, beliefs, strict=True)
    ]
