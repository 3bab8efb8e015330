"""The live plant: a building of EnergyPlus, stepped by a caller who sets its heaters and its people."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, date, datetime
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from replay.energyplus import epjson
from replay.energyplus.buildings import Building
from replay.energyplus.engine import Actuator, EnergyPlusError, Engine, Values, Variable
from replay.energyplus.heating import proportional
from replay.energyplus.library import weather_folder
from replay.energyplus.weather import WeatherFile, weather_file

STEP = epjson.STEP

FIRST_DAY = date(2025, 1, 13)
_WARM_UP_TEMPERATURE = 20.0
_WARM_UP_BAND = 2.0  # K below it, at which heaters give all they have
_AIR_HEAT_CAPACITY = 1006.0  # J/(kg K)


class Inputs(NamedTuple):
    """What acts on the rooms (N,) during one step: `heating` in W, cut to what the heaters can give; `people` as a
    number; `equipment` and `lights` in W; `opening` of windows to outdoors in W/K."""

    heating: Array
    people: Array
    equipment: Array
    lights: Array
    opening: Array


class Truth(NamedTuple):
    """What no sensor of the plant tells, per room (N,), mean over one step; flows in W, into the room: `sun` through
    the glass, `windows` through open ones, `infiltration` through joints, `doors` with the air of neighbours. The
    balance of the air is `storage = convective + convection + windows + infiltration + doors`, of which heaters,
    people, equipment and lights give `convective` at once, and all surfaces `convection`."""

    people: Array
    equipment: Array
    lights: Array
    heating: Array
    sun: Array
    windows: Array
    infiltration: Array
    doors: Array
    convective: Array
    convection: Array
    storage: Array

    @property
    def gain(self) -> Array:
        """Heat (N,) in W that nobody measures and the sun does not bring: people, equipment, lights, open windows."""
        return self.people + self.equipment + self.lights + self.windows


class Readings(NamedTuple):
    """The plant at `time` (UTC s), the boundary between two steps. `air` (N,) is in degC at that time. `outdoor`
    [degC], `irradiance` (global, horizontal) [W/m2], `wind` [m/s] and `air_density` [kg/m3] hold over the step to come;
    `facade`, on the southern wall [W/m2], and `truth` are of the step that has ended, of no use before the first."""

    time: float
    air: Array
    outdoor: float
    irradiance: float
    facade: float
    wind: float
    air_density: float
    truth: Truth


Controller = Callable[[Readings], Inputs]


class Plant:
    """A building under a year of weather that repeats, in steps of STEP s; several may live at once. `now` is what it
    shows before the next step; `step` lives that under inputs. The first moment is the local midnight (standard time of
    the weather file's place) that begins the day `begin`; before it EnergyPlus repeats the first day until the building
    has settled, under `warm_up`, by default 20 degC in empty rooms. Close it, or use it in a `with`. Raises
    EnergyPlusMissing without the extra, WeatherFileError, and EnergyPlusError where EnergyPlus gives up."""

    def __init__(
        self,
        building: Building,
        weather: WeatherFile | str = "denver",
        *,
        begin: date = FIRST_DAY,
        warm_up: Controller | None = None,
    ) -> None:
        folder = weather_folder()
        self.weather = weather_file(weather, folder) if isinstance(weather, str) else weather
        self.building = building
        self.begin = datetime(begin.year, begin.month, begin.day, tzinfo=UTC).timestamp() - self.weather.ahead_of_utc
        self._steps = 0
        self._heaters = np.array([room.heater for room in building.rooms])
        control = warm_up or self._keep_warm

        def settle(values: Values) -> Values:
            readings = self._look(values)
            return self._set(readings, control(readings))

        self._engine = Engine(
            epjson.model_of(building, begin),
            self.weather.path,
            _variables(building),
            _actuators(building),
            settle,
        )
        self.now = self._look(self._engine.first)

    def step(self, inputs: Inputs) -> Readings:
        """Live one step under `inputs`; the readings at its end. EnergyPlusError if EnergyPlus gives up."""
        values = self._engine.step(self._set(self.now, inputs))
        self._steps += 1
        self.now = self._look(values)
        return self.now

    @property
    def local_time(self) -> float:
        """Seconds since 1970-01-01 00:00 by the standard time of the place, at `now`."""
        return self.now.time + self.weather.ahead_of_utc

    def idle(self) -> Inputs:
        """Inputs with which nothing is on, nobody is there and every window is closed."""
        return Inputs(*np.zeros((len(Inputs._fields), len(self.building.rooms))))

    def close(self) -> None:
        self._engine.close()

    def __enter__(self) -> Plant:
        return self

    def __exit__(self, *of: object) -> None:
        self.close()

    def _keep_warm(self, readings: Readings) -> Inputs:
        wanted = np.full(len(self._heaters), _WARM_UP_TEMPERATURE)
        return self.idle()._replace(heating=proportional(self._heaters, readings.air, wanted, _WARM_UP_BAND))

    def _look(self, values: Values) -> Readings:
        rooms = len(self.building.rooms)
        outdoor, density, beam, diffuse, altitude, facade, wind = values[: len(_SITE)]
        table = np.array(values[len(_SITE) :]).reshape(rooms, len(_ROOM))
        of = dict(zip(_ROOM, table.T, strict=True))
        return Readings(
            time=self.begin + self._steps * STEP,
            air=of[_AIR],
            outdoor=outdoor,
            irradiance=diffuse + beam * max(math.sin(math.radians(altitude)), 0.0),
            facade=facade,
            wind=wind,
            air_density=density,
            truth=Truth(**{field: of[name] for field, name in _TRUTH.items()} | _net(of)),
        )

    def _set(self, readings: Readings, inputs: Inputs) -> Values:
        """The values of `_actuators`, in their order."""
        table = np.array([np.broadcast_to(field, self._heaters.shape) for field in inputs], dtype=np.float64)
        if not np.isfinite(table).all():
            raise EnergyPlusError("the plant was given an input that is not a finite number; give one for every room")
        table = np.maximum(table, 0.0)
        table[0] = np.minimum(table[0], self._heaters)
        table[-1] /= _AIR_HEAT_CAPACITY * readings.air_density
        return [float(value) for value in table.T.ravel()]


_SITE = (
    "Site Outdoor Air Drybulb Temperature",
    "Site Outdoor Air Density",
    "Site Direct Solar Radiation Rate per Area",
    "Site Diffuse Solar Radiation Rate per Area",
    "Site Solar Altitude Angle",
    "Surface Outside Face Incident Solar Radiation Rate per Area",
    "Site Wind Speed",
)
_TRUTH = {
    "people": "Zone People Sensible Heating Rate",
    "equipment": "Zone Electric Equipment Total Heating Rate",
    "lights": "Zone Lights Total Heating Rate",
    "heating": "Zone Other Equipment Total Heating Rate",
    "sun": "Enclosure Windows Total Transmitted Solar Radiation Rate",
    "doors": "Zone Air Heat Balance Interzone Air Transfer Rate",
    "convective": "Zone Air Heat Balance Internal Convective Heat Gain Rate",
    "convection": "Zone Air Heat Balance Surface Convection Rate",
    "storage": "Zone Air Heat Balance Air Energy Storage Rate",
}
_NET = {"windows": "Zone Ventilation Sensible Heat", "infiltration": "Zone Infiltration Sensible Heat"}
"""What EnergyPlus has as energies gained and lost."""
_AIR = "Zone Mean Air Temperature"
_ROOM = (_AIR, *_TRUTH.values(), *(f"{name} {way} Energy" for name in _NET.values() for way in ("Gain", "Loss")))


def _net(of: dict[str, Array]) -> dict[str, Array]:
    return {field: (of[f"{name} Gain Energy"] - of[f"{name} Loss Energy"]) / STEP for field, name in _NET.items()}


def _variables(building: Building) -> list[Variable]:
    southern = epjson.surface(building.rooms[0].name, "south")
    site = [Variable(name, southern if name.startswith("Surface") else "Environment") for name in _SITE]
    return site + [Variable(name, room.name) for room in building.rooms for name in _ROOM]


_INPUTS = (
    ("OtherEquipment", "Power Level", "heater"),
    ("People", "Number of People", "people"),
    ("ElectricEquipment", "Electricity Rate", "equipment"),
    ("Lights", "Electricity Rate", "lights"),
    ("Zone Ventilation", "Air Exchange Flow Rate", "windows"),
)


def _actuators(building: Building) -> list[Actuator]:
    return [
        Actuator(kind, control, epjson.part(room.name, what))
        for room in building.rooms
        for kind, control, what in _INPUTS
    ]
