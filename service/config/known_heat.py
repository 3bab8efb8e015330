"""Heat of a zone that is known up to coefficients: sun, habits, and its share of a meter of several zones."""

from collections.abc import Sequence
from dataclasses import replace

from adapters.fields.problems import Place, Problems
from estimator.errors import NetworkError
from estimator.heat.sun import Location
from estimator.heat.terms import sun_channel, with_known_heat
from estimator.network.boxes import TYPICAL_AREA
from estimator.network.buildings import NOTHING_KNOWN, Building, has_envelope, informed
from estimator.network.network import Network
from estimator.network.presets import AUTO
from estimator.registry import ESTIMATORS
from service.config.checks import ZoneDraft
from service.config.network_tables import PresetConfig
from service.config.site import Whereabouts, ZoneTable

OF_THE_ENVELOPE = ("construction", "built")
"""Keys of a zone that its network shows when it is resolved."""


def heated(network: Network, zone: ZoneTable, whereabouts: Whereabouts, place: Place, problems: Problems) -> Network:
    """`network` of the `zone` at `place` with the terms that its table asks for, or has already; of the preset "auto"
    habits, and the sun if it is measured, unless the table says otherwise. What is wrong is noted in `problems`."""
    try:
        network.validate()
    except NetworkError:
        # What is wrong with it has been said.
        return network
    if network.terms:
        return network
    area, building = _floor_area(zone), zone.building.over(whereabouts.building)
    fits = False
    if isinstance(zone.network, PresetConfig):
        if network.name == AUTO and zone.floor_area is not None:
            network = _typical_for(network, zone.floor_area)
        if has_envelope(network):
            own = [name for name, bounds in zone.network.parameters.items() if bounds.typical is not None]
            network, fits = informed(network, building, area, own), True
    for key in () if fits else OF_THE_ENVELOPE:
        if getattr(zone, key) is not None:
            sentence = (
                f'speaks of the envelope of "auto", "tite", "titeth" and "titethria", not of network "{network.name}"; '
                f"take one of these, or remove {key} and write typical and spread of the parameters"
            )
            problems.add((*place, key), sentence)
    kind = ESTIMATORS.get(zone.estimator)
    place_for_terms = kind is not None and kind.terms
    for key, asked in (("habits", zone.habits), ("sun", zone.sun)):
        if asked and not place_for_terms:
            sentence = f'has no place in the estimator "{zone.estimator}"; choose "bank" or "mkf", or remove {key}'
            problems.add((*place, key), sentence)
            return network
    auto = network.name == AUTO and place_for_terms
    habits = auto if zone.habits is None else zone.habits
    if zone.use is not None and not habits:
        problems.add((*place, "use"), "says when people heat the zone; add habits = true, or remove use")
    sun = zone.sun if isinstance(zone.sun, str) else None
    if zone.sun is None and auto:
        sun = _usual_sun(network, whereabouts.location)
    of_clouds = (*place, "channels", str(network.clouds))
    if network.clouds is not None and sun != "clear-sky":
        remedy = 'write sun = "clear-sky", which the estimators "bank" and "mkf" have a place for, or remove it'
        problems.add(of_clouds, f"dims the sun of a clear sky, which this zone does not know; {remedy}")
    try:
        return with_known_heat(
            network, habits=habits, sun=sun, location=whereabouts.location, floor_area=area, use=building.use
        )
    except NetworkError as error:
        asked_by = of_clouds if zone.sun is None else (*place, "sun")
        problems.add(asked_by, str(error).removeprefix(f'sun = "{sun}" '))
        return network


def usually_heated(
    network: Network, location: Location | None, floor_area: float | None = None, building: Building = NOTHING_KNOWN
) -> Network:
    """`network` "auto" with the terms of a zone whose table says nothing of sun and habits, in a `building`."""
    sun = _usual_sun(network, location)
    scaled = network if floor_area is None else _typical_for(network, floor_area)
    told = informed(scaled, building, floor_area)
    return with_known_heat(told, habits=True, sun=sun, location=location, floor_area=floor_area, use=building.use)


def _usual_sun(network: Network, location: Location | None) -> str | None:
    """How the sun comes into the `network` "auto" whose zone leaves it open: the best that its channels allow."""
    if sun_channel(network) is None:
        return None if network.clouds is None else "clear-sky"
    return "hours" if location is None else "facades"


def shared(drafts: Sequence[ZoneDraft], problems: Problems) -> None:
    """Give the networks of `drafts` the shares that their channels ask for: of the same meter by floor areas where all
    are known, and equal ones otherwise. What is wrong is noted in `problems`."""
    readers: dict[str, list[tuple[ZoneDraft, str]]] = {}
    for draft in drafts:
        for place, name, channel in draft.delivered:
            if channel.share is None or (unit := draft.unit(name)) is None:
                continue
            if unit != "W":
                problems.add((*place, "share"), f"is for a meter of heat in W, and {name} is in {unit}; remove it")
            elif isinstance(channel.share, str):
                readers.setdefault(channel.share, []).append((draft, name))
            else:
                _share(draft, name, channel.share, problems)
    named = [channel.share for draft in drafts for channel in draft.channels.values()]
    for meter, found in readers.items():
        areas = [None if draft.table is None else _floor_area(draft.table) for draft, _ in found]
        known = [area for area in areas if area is not None]
        if len(known) < len(found):
            known = [1.0] * len(found)
        for (draft, name), area in zip(found, known, strict=True):
            # A zone whose network is wrong has a share, too.
            if named.count(meter) == 1:
                sentence = (
                    f'is "{meter}", which no other zone has a share of; name it in the other zones that it meters, or '
                    "give the share of this one that is likely, such as 0.2"
                )
                problems.add((*draft.place, "channels", name, "share"), sentence)
            _share(draft, name, area / sum(known), problems)


def _share(draft: ZoneDraft, channel: str, typical: float, problems: Problems) -> None:
    assert draft.network is not None
    try:
        draft.network = draft.network.with_share(channel, typical)
    except NetworkError as error:
        problems.add((*draft.place, "channels", channel, "share"), f"{error}; remove it")


def _floor_area(zone: ZoneTable) -> float | None:
    """The floor area [m2] that the table says, or that the bounds of the network follow from, if it is one."""
    if zone.floor_area is not None:
        return zone.floor_area
    box = zone.network.box if isinstance(zone.network, PresetConfig) else None
    return box.floor_area[0] if box is not None and box.floor_area[0] == box.floor_area[1] else None


def _typical_for(network: Network, floor_area: float) -> Network:
    """`network` with typical values for another floor area [m2] than that of a zone whose area nobody knows."""
    share = floor_area / TYPICAL_AREA
    return replace(
        network,
        parameters=tuple(
            p if p.typical is None else replace(p, typical=min(max(p.typical * share, p.lower), p.upper))
            for p in network.parameters
        ),
    )
