"""The buildings: boxes with windows, walls of their own, heaters, and the people who live or work in them.

They are invented. The heavy house has walls like case 900 of the standard ASHRAE 140 (BESTEST), which stands for
buildings that hold their heat; geometry, windows and use are its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from replay.energyplus.construction import (
    BLOCK,
    BRICK,
    CONCRETE,
    FIBRE,
    FOAM,
    PLASTERBOARD,
    SCREED,
    TILES,
    TIMBER,
    Construction,
    Glazing,
    Layer,
)
from replay.energyplus.people import BEDROOMS, DESK, FAMILY, HALL, KITCHEN_LIVING, Use
from replay.errors import ReplayError

Side = Literal["south", "east", "north", "west", "floor", "ceiling"]

SIDES: tuple[Side, ...] = ("south", "east", "north", "west", "floor", "ceiling")
OPPOSITE: Mapping[Side, Side] = {
    "south": "north",
    "north": "south",
    "east": "west",
    "west": "east",
    "floor": "ceiling",
    "ceiling": "floor",
}


@dataclass(frozen=True)
class Room:
    """A box of air: its lower south-western `corner` and its `size` in m, both (east, north, up).

    A side is shared with the room that `beside` names, or else outdoors; `windows` are areas of glass in m2 by side.
    `heater` is the rated power in W of its electric panel.
    """

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

    @property
    def floor_area(self) -> float:
        """In m2."""
        return self.size[0] * self.size[1]


@dataclass(frozen=True)
class Building:
    """Rooms, and what is around and between them.

    `partition` is between rooms side by side, `storey` between rooms above each other. `air_changes` per hour are those
    of the joints in the envelope, at 20 K between inside and outside and a wind of 3.4 m/s. `doors` m3/s of air are
    exchanged between neighbours.
    """

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

    def room(self, name: str) -> Room:
        """The room called `name`."""
        return next(room for room in self.rooms if room.name == name)

    def neighbours(self, index: int) -> tuple[int, ...]:
        """Indices of the rooms that share a side with room `index`, ascending."""
        beside = set(self.rooms[index].beside.values())
        return tuple(other for other, room in enumerate(self.rooms) if room.name in beside)


HOUSE = Building(
    name="house",
    what="a heavy two-storey house with large windows to the south",
    rooms=(
        Room(
            "ground",
            (0.0, 0.0, 0.0),
            (8.0, 6.0, 2.7),
            heater=4000.0,
            use=KITCHEN_LIVING,
            windows={"south": 6.0, "east": 1.5, "west": 1.5},
            beside={"ceiling": "upper"},
        ),
        Room(
            "upper",
            (0.0, 0.0, 2.7),
            (8.0, 6.0, 2.5),
            heater=3000.0,
            use=BEDROOMS,
            windows={"south": 4.0, "north": 1.0},
            beside={"floor": "ground"},
        ),
    ),
    wall=(Layer(TIMBER, 0.009), Layer(FOAM, 0.0615), Layer(BLOCK, 0.1)),
    roof=(Layer(TILES, 0.02), Layer(FOAM, 0.15), Layer(PLASTERBOARD, 0.0125)),
    ground=(Layer(FOAM, 0.12), Layer(CONCRETE, 0.1)),
    partition=(Layer(BLOCK, 0.1),),
    storey=(Layer(CONCRETE, 0.15), Layer(SCREED, 0.05)),
    glazing=Glazing(u_value=1.6, solar_heat_gain=0.6),
    air_changes=0.4,
    doors=0.02,
)

TIMBER_HOUSE = Building(
    name="timber",
    what="a light timber house of one room",
    rooms=(
        Room(
            "house",
            (0.0, 0.0, 0.0),
            (10.0, 7.0, 2.6),
            heater=6000.0,
            use=FAMILY,
            windows={"south": 4.0, "east": 1.5, "north": 1.0, "west": 1.5},
        ),
    ),
    wall=(Layer(TIMBER, 0.02), Layer(FIBRE, 0.16), Layer(PLASTERBOARD, 0.0125)),
    roof=(Layer(TILES, 0.02), Layer(FIBRE, 0.24), Layer(PLASTERBOARD, 0.0125)),
    ground=(Layer(FIBRE, 0.16), Layer(TIMBER, 0.022)),
    partition=(Layer(PLASTERBOARD, 0.025),),
    storey=(Layer(TIMBER, 0.04),),
    glazing=Glazing(u_value=1.3, solar_heat_gain=0.55),
    air_changes=0.5,
    doors=0.0,
)

OFFICE = Building(
    name="office",
    what="an office: two rooms with a hall between them",
    rooms=(
        Room(
            "west",
            (0.0, 0.0, 0.0),
            (5.0, 6.0, 3.0),
            heater=3000.0,
            use=DESK,
            windows={"south": 4.0, "west": 2.0},
            beside={"east": "hall"},
        ),
        Room(
            "hall",
            (5.0, 0.0, 0.0),
            (2.5, 6.0, 3.0),
            heater=1500.0,
            use=HALL,
            windows={"north": 2.0},
            beside={"west": "west", "east": "east"},
        ),
        Room(
            "east",
            (7.5, 0.0, 0.0),
            (5.0, 6.0, 3.0),
            heater=3000.0,
            use=DESK,
            windows={"south": 4.0, "east": 2.0},
            beside={"west": "hall"},
        ),
    ),
    wall=(Layer(BRICK, 0.1), Layer(FOAM, 0.08), Layer(BLOCK, 0.14), Layer(PLASTERBOARD, 0.0125)),
    roof=(Layer(TILES, 0.02), Layer(FOAM, 0.16), Layer(CONCRETE, 0.16)),
    ground=(Layer(FOAM, 0.1), Layer(CONCRETE, 0.12), Layer(SCREED, 0.05)),
    partition=(Layer(PLASTERBOARD, 0.025), Layer(FIBRE, 0.05), Layer(PLASTERBOARD, 0.025)),
    storey=(Layer(CONCRETE, 0.2),),
    glazing=Glazing(u_value=1.6, solar_heat_gain=0.5),
    air_changes=0.4,
    doors=0.01,
)

BUILDINGS: Mapping[str, Building] = {building.name: building for building in (HOUSE, TIMBER_HOUSE, OFFICE)}


def building_named(name: str) -> Building:
    """The building called `name`; ReplayError listing the names where there is none."""
    try:
        return BUILDINGS[name]
    except KeyError:
        raise ReplayError(f"there is no building '{name}'; the buildings are {', '.join(BUILDINGS)}") from None
