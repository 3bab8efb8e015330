"""Forecasts as JSON in the form of Open-Meteo: `{"hourly": {"time": [...], "temperature_2m": [...]}}`."""

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np

from adapters.errors import SourceUnavailable
from adapters.fields.words import printable
from adapters.payload.objects import KeyTwice, distinct
from adapters.units import SYMBOLS
from adapters.weather.forecast import Array, WeatherForecast, WeatherSeries, series_of

LONGEST = 4 * 10**6
"""Bytes of a document at most."""

_BLOCKS = ("minutely_15", "hourly")
"""Blocks of a document that hold series, the finest first: of a series that is in both, the finest counts."""

_MOST_AHEAD = 86400.0
"""s that a local time may be ahead of UTC."""
_PRECEDING = ("radiation", "irradiance")


def parse(text: bytes, arrived: float) -> WeatherForecast:
    """The forecast in a document that `arrived` at UTC s; SourceUnavailable says what is wrong. Times are s since 1970,
    or text, without a zone in `utc_offset_seconds`; `issued` (RFC 3339) counts if not after it arrived."""
    if len(text) > LONGEST:
        raise SourceUnavailable(f"the document is longer than {LONGEST} bytes; ask for fewer series or fewer days")
    try:
        document = json.loads(text, object_pairs_hook=distinct)
    except KeyTwice as error:
        raise SourceUnavailable(f"the document {error}") from None
    except (ValueError, RecursionError) as error:
        raise SourceUnavailable(f"this is not JSON ({error})") from None
    if not isinstance(document, dict):
        raise SourceUnavailable("the document is no JSON object with the block hourly")
    if document.get("error") is True:
        raise SourceUnavailable(f"the service refuses: {printable(str(document.get('reason', 'it does not say why')))}")
    series: dict[str, WeatherSeries] = {}
    for block in reversed(_BLOCKS):
        if block in document:
            series |= _series(document, block)
    if not series:
        raise SourceUnavailable(f"the document has no series; it needs a block {' or '.join(reversed(_BLOCKS))}")
    issued = document.get("issued")
    # One from the future, or from no time, would never be too old.
    return WeatherForecast(arrived if issued is None else min(arrived, float(_seconds([issued], 0.0)[0])), series)


def _series(document: Mapping[str, Any], block: str) -> dict[str, WeatherSeries]:
    columns, units = document[block], document.get(f"{block}_units", {})
    if not isinstance(columns, dict) or not isinstance(columns.get("time"), list) or not isinstance(units, dict):
        raise SourceUnavailable(f"the block {block} has no list of times called time")
    offset = document.get("utc_offset_seconds", 0)
    if isinstance(offset, bool) or not isinstance(offset, int | float) or not abs(offset) <= _MOST_AHEAD:
        raise SourceUnavailable(
            f"utc_offset_seconds is {printable(repr(offset))}; it must be a number of at most a day"
        )
    times = _seconds(columns["time"], float(offset))
    found = {}
    for name, values in columns.items():
        if name == "time":
            continue
        if not isinstance(values, list) or len(values) != len(times):
            raise SourceUnavailable(f"{block}.{name} must be a list with as many values as there are times")
        if not all(
            value is None or (isinstance(value, int | float) and not isinstance(value, bool)) for value in values
        ):
            raise SourceUnavailable(f"{block}.{name} must hold numbers or null")
        try:
            numbers = np.array([np.nan if value is None else value for value in values], dtype=np.float64)
        except OverflowError:
            raise SourceUnavailable(f"{block}.{name} holds a number too large for any weather") from None
        unit = str(units.get(name, ""))
        # Radiation is told as the mean of the time before, unless the name says instant.
        preceding = any(word in name for word in _PRECEDING) and not name.endswith("_instant")
        found[name] = series_of(times, numbers, SYMBOLS.get(unit, unit), "preceding" if preceding else "instant")
    return found


def _seconds(times: list[Any], offset: float) -> Array:
    """UTC s of times as numbers or as RFC 3339; those without a zone are `offset` s ahead of UTC."""
    seconds = np.full(len(times), np.nan)
    for place, value in enumerate(times):
        try:
            if isinstance(value, str):
                moment = datetime.fromisoformat(value)
                ahead = 0.0 if moment.tzinfo else offset
                seconds[place] = moment.replace(tzinfo=moment.tzinfo or UTC).timestamp() - ahead
            elif isinstance(value, int | float) and not isinstance(value, bool):
                seconds[place] = float(value)
            else:
                raise ValueError
        except (ValueError, OverflowError):
            raise SourceUnavailable(
                f"{printable(repr(value))} is no time; write 2026-01-31T12:00 or seconds since 1970"
            ) from None
    return seconds
