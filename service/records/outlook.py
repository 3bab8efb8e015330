"""What is known of the inputs to come: where each comes from, what may be planned, and the forecasts of the weather."""

from collections.abc import Mapping
from typing import NamedTuple

from adapters.reading import Quality
from adapters.units import Affine
from adapters.weather.forecast import WeatherForecast
from estimator.arrays import Array
from service.records.record import Number, record, shown

SET_POINTS = "T_set"
"""What a plan of set-points [degC] is called, of a zone with a set-point whose network has no input of that name."""
SET_POINT_RANGE = (5.0, 35.0)
"""degC that can be planned as the set-point of a room, where its channel does not say what is valid."""


@record
class InputOrigin:
    """Where the values of an input in the steps after the first come from."""

    channel: str
    # The request; the law of the thermostat; the forecast of the zone next door; a forecast of the weather; the values
    # of the day before; the last measured value: from the first choice to the last.
    origin: str = shown("plan, thermostat, neighbour, weather, yesterday or held")
    source: str = shown("the zone or the forecast of the weather that they are from; empty otherwise")
    age: Number = shown("age at issue time of that forecast or of the held value, s; null for a plan", key="age_s")
    quality: Quality = shown("uncertain where it covers the horizon in part only")


class Outlook(NamedTuple):
    """The inputs (h, n_u) of the steps to come, in the order of the network, and where each comes from."""

    rows: Array
    origins: tuple[InputOrigin, ...]

    @property
    def known(self) -> list[str]:
        """The inputs that the zone does not foresee itself."""
        return [origin.channel for origin in self.origins if origin.origin not in ("yesterday", "held")]


class WeatherLink(NamedTuple):
    """An input that a forecast of the weather foresees: the source's name, the series, the unit that it is expected in,
    and how that becomes the network's. A forecast older than `max_age` s at issue time is not used."""

    source: str
    series: str
    unit: str
    conversion: Affine
    max_age: float


class WeatherBook:
    """The newest forecast of every source; written by its task, read from any thread."""

    def __init__(self) -> None:
        self._newest: dict[str, WeatherForecast] = {}

    def put(self, source: str, forecast: WeatherForecast) -> None:
        # A dictionary that readers hold is not changed.
        self._newest = self._newest | {source: forecast}

    def keep(self, sources: frozenset[str]) -> None:
        """Forget what came from others than `sources`."""
        self._newest = {name: forecast for name, forecast in self._newest.items() if name in sources}

    def newest(self, source: str) -> WeatherForecast | None:
        """The newest forecast of `source`; None before the first."""
        return self._newest.get(source)


class Weather(NamedTuple):
    """The inputs that forecasts of the weather foresee, by channel, and where those are."""

    links: Mapping[str, WeatherLink] = {}
    book: WeatherBook = WeatherBook()


class Surroundings(NamedTuple):
    """What a zone's configuration says of its inputs beyond where they are measured."""

    limits: Mapping[str, tuple[float, float]] = {}
    """The smallest and the largest believable value of every channel, in the network's unit; of an input that is
    planned, no more than is installed."""
    neighbours: Mapping[str, tuple[str, str]] = {}
    """Inputs that are the output of another zone: (zone, output)."""
    weather: Mapping[str, WeatherLink] = {}
    """Inputs that a forecast of the weather foresees."""
    floor_area: float = float("nan")
    """m2; NaN where nobody says it."""
    entered: bool = False
    """Whether the power at 100 % of an input is entered, as of a valve."""


NO_SURROUNDINGS = Surroundings()
