"""What happens to a building while it is controlled, what heat costs, and how warm it has to be."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.energyplus.buildings import Building, building_named
from replay.energyplus.library import weather_folder
from replay.energyplus.people import Life
from replay.energyplus.plant import STEP, Inputs
from replay.energyplus.weather import weather_file
from replay.localtime import DAY, HOUR
from replay.scores.intervals import Mask
from service.config.site import Whereabouts

STEPS_A_DAY = round(DAY / STEP)
WARMEST = 24.0
"""Upper end of the comfort band at all times, degC; the lower end is the set-point of the room's `Use`."""

NIGHT, PEAK = (22.0, 6.0), (17.0, 20.0)
"""Local hours of the cheap and of the dear tariff."""
PRICES = {"night": 0.20, "day": 0.32, "peak": 0.48}
"""Per kWh."""

_WEEK = 7
_GUESTS = (3, 19.0, 5.0)
_WINDOWS = (5, 8.0, 3.0)
"""Day of the controlled week, local hour at which it begins, and hours that it lasts."""
_GUEST_COUNT, _GUEST_EQUIPMENT, _WINDOW = 12.0, 800.0, 120.0
"""Persons, W, and W/K of windows that somebody forgot to close."""
_FAULT = ((3, 3.0), (3, 12.0), (3, 20.0), (3, 8.0))
"""Day and local hour at which a fault begins in each controlled week, for a day."""


UNDISTURBED, PARTIES, STUCK, OFF, START = "undisturbed", "parties", "stuck sensor", "boiler off", "new season"
CASES: Mapping[str, str] = {
    UNDISTURBED: "People live there by their habits: they come and go, cook, and open windows for minutes.",
    PARTIES: "Once a week twelve guests come for an evening; once a week windows stay open for hours of a morning.",
    STUCK: "Once a week the thermometer of the first room sticks at its last value for a day.",
    OFF: "Once a week the boiler gives no heat for a day, whatever is asked of it; nothing is metered then.",
    START: "The heating season begins: nothing was learned before the first controlled day.",
}


class Scene(NamedTuple):
    """A building, its weather and people for `days` days, the last `controlled` of which are controlled and scored."""

    building: str
    weather: str
    case: str
    seed: int
    days: int
    controlled: int

    @property
    def steps(self) -> int:
        return self.days * STEPS_A_DAY

    @property
    def controlled_from(self) -> int:
        return (self.days - self.controlled) * STEPS_A_DAY

    @property
    def of(self) -> Building:
        return building_named(self.building)

    @property
    def whereabouts(self) -> Whereabouts:
        return Whereabouts(weather_file(self.weather, weather_folder()).location)

    def life(self) -> Life:
        return Life([room.use for room in self.of.rooms], STEP, self.seed)


def price(local: float) -> float:
    """Of a kWh at local seconds."""
    hour = local % DAY / HOUR
    if hour >= NIGHT[0] or hour < NIGHT[1]:
        return PRICES["night"]
    return PRICES["peak"] if PEAK[0] <= hour < PEAK[1] else PRICES["day"]


def lived(scene: Scene, life: Life, index: int, local: float, heating: Array) -> Inputs:
    """What acts in step `index`: the people of `life`, those of the case, and `heating` (N,) in W."""
    people, equipment, lights, opening = (np.array(field, dtype=np.float64) for field in life.at(local))
    if scene.case == PARTIES:
        # Days since control began; the plant begins at midnight.
        day, hour = (index - scene.controlled_from) // STEPS_A_DAY, (index % STEPS_A_DAY) * STEP / HOUR
        if day >= 0 and _acts(_GUESTS, day, hour):
            people[0] += _GUEST_COUNT
            equipment[0] += _GUEST_EQUIPMENT
        if day >= 0 and _acts(_WINDOWS, day, hour):
            opening[0] += _WINDOW
    return Inputs(heating, people, equipment, lights, opening)


def steps_with(fault: str, scene: Scene) -> Mask:
    """(K,): the steps in which the first room's thermometer sticks (STUCK), or no heater gives heat (OFF)."""
    faulty = np.zeros(scene.steps, dtype=np.bool_)
    if scene.case == fault:
        for week in range(-(-scene.controlled // _WEEK)):
            day, hour = _FAULT[week % len(_FAULT)]
            begin = scene.controlled_from + round(
                ((week * _WEEK + min(day, scene.controlled - 1)) * DAY + hour * HOUR) / STEP
            )
            faulty[begin : begin + STEPS_A_DAY] = True
    return faulty


def _acts(event: tuple[int, float, float], day: int, hour: float) -> bool:
    on, begin, hours = event
    return day % _WEEK == on and begin <= hour < begin + hours
