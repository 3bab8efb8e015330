"""The buildings of `buildings.toml`: boxes with windows, walls, heaters, and the people who live or work in them."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any, Literal, NamedTuple

from pydantic import TypeAdapter

from replay.energyplus.people import Use
from replay.errors import ReplayError
from replay.simulated.events import EVERY_DAY, WEEKDAYS, WEEKEND

Side = Literal["south", "east", "north", "west", "floor", "ceiling"]

SIDES: tuple[Side, ...] = ("south", "east", "north", "west", "floor", "ceiling")
_FACING: tuple[tuple[Side, Side], ...] = (("south", "north"), ("east", "west"), ("floor", "ceiling"))
OPPOSITE: Mapping[Side, Side] = {one: other for pair in _FACING for one, other in (pair, pair[::-1])}
PARTS = ("wall", "roof", "ground", "partition", "storey")
"""What a building is made of, each of layers."""


class Material(NamedTuple):
    """Conductivity [W/(m K)], density [kg/m3] and specific heat [J/(kg K)]."""

    name: str
    conductivity: float
    density: float
    specific_heat: float


class Layer(NamedTuple):
    """A material, `thickness` m of it."""

    material: Material
    thickness: float


Construction = tuple[Layer, ...]
"""Layers from the outside in."""


class Glazing(NamedTuple):
    """A window by its U-value [W/(m2 K)] and the share of the sun that it lets in as heat."""

    u_value: float
    solar_heat_gain: float


@dataclass(frozen=True)
class Room:
    """A box of air: its lower south-western `corner` and `size` in m, both (east, north, up); `windows` are m2 of glass
    by side. A side is shared with the room that `beside` names, or else outdoors. `heater` is the rated power in W."""

    name: str
    corner: tuple[float, float, float]
    size: tuple[float, float, float]
    heater: float
    use: Use
    windows: Mapping[Side, float] = field(default_factory=dict)
    beside: Mapping[Side, str] = field(default_factory=dict)

    @property
    def volume(self) -> float:
        """Of its air, m3."""
        return self.size[0] * self.size[1] * self.size[2]


@dataclass(frozen=True)
class Building:
    """Rooms, and what is around and between them: `partition` side by side, `storey` above each other. `air_changes`
    per hour are those of the joints, at 20 K between inside and outside and a wind of 3.4 m/s; `doors` m3/s of air are
    exchanged between neighbours."""

    name: str
    what: str
    rooms: tuple[Room, ...]
    wall: Construction
    roof: Construction
    ground: Construction
    partition: Construction
    storey: Construction
    glazing: Glazing
    air_changes: float
    doors: float

    def neighbours(self, index: int) -> tuple[int, ...]:
        """Indices of the rooms that share a side with room `index`, ascending."""
        beside = set(self.rooms[index].beside.values())
        return tuple(other for other, room in enumerate(self.rooms) if room.name in beside)


def _read() -> dict[str, Building]:
    raw = tomllib.loads(files(__package__).joinpath("buildings.toml").read_text(encoding="utf-8"))
    days = {"every day": EVERY_DAY, "weekdays": WEEKDAYS, "weekend": WEEKEND}

    def used(table: dict[str, Any]) -> dict[str, Any]:
        habits = {kind: [(days[first], *rest) for first, *rest in table[kind]] for kind in Use._fields[:4]}
        return table | habits | {"days": days[table.get("days", "every day")]}

    def made(layers: Sequence[tuple[str, float]]) -> list[Layer]:
        return [Layer(Material(name, *raw["materials"][name]), thickness) for name, thickness in layers]

    uses = {name: used(table) for name, table in raw["uses"].items()}
    for building in raw["buildings"]:
        building |= {part: made(building[part]) for part in PARTS}
        building["rooms"] = [room | {"use": uses[room["use"]]} for room in building["rooms"]]
    return {one.name: one for one in TypeAdapter(list[Building]).validate_python(raw["buildings"])}


BUILDINGS: Mapping[str, Building] = _read()


def building_named(name: str) -> Building:
    """The building called `name`; ReplayError listing the names where there is none."""
    if name not in BUILDINGS:
        raise ReplayError(f"there is no building '{name}'; the buildings are {', '.join(BUILDINGS)}")
    return BUILDINGS[name]
