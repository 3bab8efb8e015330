"""Typical years of weather as EPW files: those that come with EnergyPlus by name, and any other by its path."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from replay.errors import WeatherFileError
from replay.localtime import HOUR

CITIES: Mapping[str, str] = {
    "chicago": "USA_IL_Chicago-OHare.Intl.AP.725300_TMY3.epw",
    "denver": "USA_CO_Golden-NREL.724666_TMY3.epw",
    "san-francisco": "USA_CA_San.Francisco.Intl.AP.724940_TMY3.epw",
    "tampa": "USA_FL_Tampa.Intl.AP.722110_TMY3.epw",
    "washington": "USA_VA_Sterling-Washington.Dulles.Intl.AP.724030_TMY3.epw",
}


class WeatherFile(NamedTuple):
    """An EPW file, the place that it names, and how many s its standard time is ahead of UTC (no daylight saving)."""

    path: Path
    place: str
    ahead_of_utc: int


def weather_file(name: str, packaged: Path) -> WeatherFile:
    """The file of a city of CITIES, in the folder `packaged`, or the EPW file at the path `name`.

    WeatherFileError where there is none, or where it is no EPW file.
    """
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
        hours = float(cells[8])
    except ValueError:
        raise WeatherFileError(f"weather {path}: its time zone {cells[8]!r} is not a number of hours") from None
    return WeatherFile(path.resolve(), cells[1].strip(), round(hours * HOUR))
