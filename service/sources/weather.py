"""Forecasts of the weather, as [weather.<name>] tables."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self
from zoneinfo import ZoneInfo

from pydantic import BaseModel, BeforeValidator, Field, model_validator

from adapters.csv.table import Layout
from adapters.timestamps import timestamp_parser
from adapters.weather.forecast import MEANS, WeatherSource
from adapters.weather.heard import HeardForecasts
from adapters.weather.polled import PolledAddress, csv_file, json_file
from adapters.zenoh.access import ANYBODY, collecting
from service.fields.addresses import is_web_address
from service.fields.tables import TABLE
from service.fields.values import Delimiter, Encoding, FilePath, PositiveDuration, Text, choice
from service.fields.zenoh_session import Mode, SessionConfig
from service.sources.csv import TimestampConfig, require_distinct

_DAY = 86400.0


class WeatherCsvConfig(BaseModel):
    """[weather.<name>] of kind "csv": a file that is written anew with every forecast."""

    model_config = TABLE

    kind: Literal["csv"] = "csv"
    file: FilePath = Field(description='the path of the file, such as "forecast.csv"')
    timestamp: TimestampConfig = Field(
        description='a table such as { column = "Timestamp", format = "iso8601", zone = "Europe/Berlin" }'
    )
    delimiter: Delimiter = ","
    decimal: Annotated[str, BeforeValidator(choice(".", ","))] = "."
    encoding: Encoding = "utf-8"
    means: Annotated[str, BeforeValidator(choice(*MEANS))] = "instant"
    refresh: PositiveDuration = 60.0
    max_age: PositiveDuration = _DAY

    @model_validator(mode="after")
    def _readable(self) -> Self:
        require_distinct(self.delimiter, self.decimal)
        return self

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""
        return self.file.name


class OpenMeteoConfig(BaseModel):
    """[weather.<name>] of kind "open-meteo": its JSON in a file or at an address."""

    model_config = TABLE

    kind: Literal["open-meteo"] = "open-meteo"
    file: FilePath | None = None
    url: Text | None = None
    refresh: PositiveDuration = 3600.0
    max_age: PositiveDuration = _DAY

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.file is None) == (self.url is None):
            raise ValueError("needs either file or url")
        if self.url is not None and not self.url.startswith(("http://", "https://")):
            raise ValueError("url must begin with http:// or https://")
        if self.url is not None and not is_web_address(self.url):
            raise ValueError("url must be an address such as https://api.example/v1/forecast?latitude=47.7")
        return self

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""
        # An address may carry a key of the service.
        return self.file.name if self.file is not None else str(self.url).partition("?")[0]


class ZenohWeatherConfig(SessionConfig):
    """[weather.<name>] of kind "zenoh": the same JSON, published on a key."""

    kind: Literal["zenoh"] = "zenoh"
    mode: Mode = "client"
    key: Text = Field(description='the key that documents are published on, such as "site/weather"')
    max_age: PositiveDuration = _DAY

    @model_validator(mode="after")
    def _reachable(self) -> Self:
        if not self.connect or self.listen:
            raise ValueError('needs connect, such as connect = ["tcp/192.168.1.30:7447"], and no listen')
        return self

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""
        return f"{self.key} from {', '.join(self.connect)}"


class WeatherKind(NamedTuple):
    """A kind of forecast: its table, and how a source is built from its name, table and the series it is asked for."""

    table: type[Any]
    build: Callable[[str, Any, tuple[str, ...]], WeatherSource]


def _csv(name: str, table: WeatherCsvConfig, series: tuple[str, ...]) -> WeatherSource:
    stamp = table.timestamp
    layout = Layout(
        stamp.column,
        timestamp_parser(stamp.format),
        None if stamp.zone is None else ZoneInfo(stamp.zone),
        table.delimiter,
        table.decimal,
        table.encoding,
    )
    return csv_file(name, table.file, table.refresh, layout, table.means, series)


def _open_meteo(name: str, table: OpenMeteoConfig, series: tuple[str, ...]) -> WeatherSource:
    if table.url is not None:
        return PolledAddress(name, table.url, table.refresh)
    return json_file(name, table.file or Path(), min(table.refresh, 60.0))


def _zenoh(name: str, table: ZenohWeatherConfig, series: tuple[str, ...]) -> WeatherSource:
    return HeardForecasts(name, table.session(collecting((ANYBODY,), relaying=False)), table.key)


WEATHER_KINDS = {
    "csv": WeatherKind(WeatherCsvConfig, _csv),
    "open-meteo": WeatherKind(OpenMeteoConfig, _open_meteo),
    "zenoh": WeatherKind(ZenohWeatherConfig, _zenoh),
}
"""Kinds of forecasts by name."""
