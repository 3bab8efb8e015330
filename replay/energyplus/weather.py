"""Typical years of weather as EPW files: those that come with EnergyPlus by name, and any other by its path."""

from collections.abc import Mapping
from datetime import date, timedelta
from pathlib import Path
from typing import NamedTuple

from estimator.heat.sun import Location
from replay.errors import WeatherFileError
from replay.localtime import HOUR

CITIES: Mapping[str, str] = {
    "chicago": "USA_IL_Chicago-OHare.Intl.AP.725300_TMY3.epw",
    "denver": "USA_CO_Golden-NREL.724666_TMY3.epw",
    "san-francisco": "USA_CA_San.Francisco.Intl.AP.724940_TMY3.epw",
    "tampa": "USA_FL_Tampa.Intl.AP.722110_TMY3.epw",
    "washington": "USA_VA_Sterling-Washington.Dulles.Intl.AP.724030_TMY3.epw",
}

_ANY_YEAR = 2023
_STEFAN_BOLTZMANN = 5.670374e-8  # W/(m2 K4)
_UNSURE = "?9" * 20
"""Where the values of a row come from, as far as anybody says."""


class WeatherFile(NamedTuple):
    """An EPW file, the place it names, where that is, and s by which its standard time is ahead of UTC."""

    path: Path
    place: str
    location: Location
    ahead_of_utc: int


def weather_file(name: str, packaged: Path) -> WeatherFile:
    """The file of a city of CITIES, in the folder `packaged`, or the EPW file `name`; else WeatherFileError."""
    path = packaged / CITIES[name] if name in CITIES else Path(name)
    if path.suffix.lower() != ".epw":
        raise WeatherFileError(
            f"weather '{name}': it is neither one of {', '.join(CITIES)} nor the path of an EPW file (TMY3 as .epw)"
        )
    try:
        with path.open(encoding="utf-8", errors="replace") as lines:
            cells = next(lines, "").split(",")
    except OSError as error:
        raise WeatherFileError(f"weather {path}: {error.strerror}; give the path of an EPW file") from None
    if cells[0] != "LOCATION" or len(cells) < 10:
        raise WeatherFileError(f"weather {path}: an EPW file begins with LOCATION, and this one does not")
    try:
        latitude, longitude, hours = map(float, cells[6:9])
    except ValueError:
        raise WeatherFileError(
            f"weather {path}: latitude, longitude and time zone, {', '.join(cells[6:9])!r}, are not three numbers"
        ) from None
    return WeatherFile(path.resolve(), cells[1].strip(), Location(latitude, longitude), round(hours * HOUR))


def write_steady(path: Path, place: WeatherFile, *, outdoor: float, wind: float) -> WeatherFile:
    """Write a year at `place` in which nothing changes: no sun, a sky as warm as the air, `outdoor` degC, `wind` m/s,
    the pressure of the place's height. Returns the file at `path`."""
    with place.path.open(encoding="utf-8", errors="replace") as lines:
        location = next(lines).rstrip("\n")
    height = float(location.split(",")[9])
    pressure = round(101_325.0 * (1.0 - 2.25577e-5 * height) ** 5.25588)
    infrared = round(_STEFAN_BOLTZMANN * (outdoor + 273.15) ** 4)
    # Temperature, dew point, humidity, pressure; no radiation but that of the sky; wind from the west; overcast.
    values = f"{outdoor:.1f},{outdoor - 5.0:.1f},70,{pressure},0,0,{infrared},0,0,0,0,0,0,0,270,{wind:.1f},10,10,"
    values += "20,77777,9,999999999,10,0.1,0,88,0.2,0,0"
    days = [date(_ANY_YEAR, 1, 1) + timedelta(days=day) for day in range(365)]
    hours = [f"{_ANY_YEAR},{day.month},{day.day},{hour},60,{_UNSURE},{values}" for day in days for hour in range(1, 25)]
    head = [
        location,
        "DESIGN CONDITIONS,0",
        "TYPICAL/EXTREME PERIODS,0",
        "GROUND TEMPERATURES,0",
        "HOLIDAYS/DAYLIGHT SAVINGS,No,0,0,0",
        "COMMENTS 1,steady weather for a co-heating test",
        "COMMENTS 2,",
        "DATA PERIODS,1,1,Data,Sunday,1/1,12/31",
    ]
    path.write_text("\n".join([*head, *hours]) + "\n", encoding="utf-8")
    return place._replace(path=path)
