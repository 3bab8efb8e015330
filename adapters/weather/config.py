"""Forecasts of the weather, as [weather.<name>] tables."""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from adapters.csv.config import LayoutConfig
from adapters.fields.addresses import is_web_address
from adapters.fields.tables import Table
from adapters.fields.values import FilePath, PositiveDuration, Text, choice
from adapters.weather.forecast import MEANS, WeatherSource
from adapters.weather.heard import HeardForecasts
from adapters.weather.polled import csv_file, json_address, json_file
from adapters.zenoh.connection import Mode, SessionConfig

_DAY = 86400.0


class WeatherConfig(Table):
    """[weather.<name>]: the table of a forecast. A kind of forecast is a subclass of it, listed in WEATHER_KINDS."""

    kind: str
    max_age: PositiveDuration = Field(default=_DAY, description="an older forecast is not used")

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""
        raise NotImplementedError

    def build(self, name: str, series: tuple[str, ...]) -> WeatherSource:
        """The source called `name`, which is asked for `series`."""
        raise NotImplementedError


class WeatherCsvConfig(LayoutConfig, WeatherConfig):
    """[weather.<name>] of kind "csv": a file that is written anew with every forecast."""

    kind: Literal["csv"] = "csv"
    file: FilePath = Field(description='the path of the file, such as "forecast.csv"')
    means: Annotated[str, BeforeValidator(choice(*MEANS))] = Field(
        default="instant",
        description="what a value is about: its instant, the time since the one before or until the next",
    )
    refresh: PositiveDuration = Field(default=60.0, description="how often the file is looked at")

    @property
    def described(self) -> str:
        return self.file.name

    def build(self, name: str, series: tuple[str, ...]) -> WeatherSource:
        return csv_file(name, self.file, self.refresh, self, self.means, series)


class OpenMeteoConfig(WeatherConfig):
    """[weather.<name>] of kind "open-meteo": its JSON in a file or at an address."""

    kind: Literal["open-meteo"] = "open-meteo"
    file: FilePath | None = Field(default=None, description="the JSON in a file, looked at every minute")
    url: Text | None = Field(default=None, description="its address, beginning with `http://` or `https://`")
    refresh: PositiveDuration = Field(default=3600.0, description="how often the address is asked")

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
        # An address may carry a key of the service.
        return self.file.name if self.file is not None else str(self.url).partition("?")[0]

    def build(self, name: str, series: tuple[str, ...]) -> WeatherSource:
        if self.url is not None:
            return json_address(name, self.url, self.refresh)
        return json_file(name, self.file or Path(), min(self.refresh, 60.0))


class ZenohWeatherConfig(SessionConfig, WeatherConfig):
    """[weather.<name>] of kind "zenoh": the same JSON, published on a key."""

    kind: Literal["zenoh"] = "zenoh"
    mode: Mode = Field(default="client", description="role of the session")
    key: Text = Field(description='the key that documents are published on, such as "site/weather"')

    @model_validator(mode="after")
    def _reachable(self) -> Self:
        if not self.connect or self.listen:
            raise ValueError('needs connect, such as connect = ["tcp/192.168.1.30:7447"], and no listen')
        return self

    @property
    def described(self) -> str:
        return f"{self.key} from {', '.join(self.connect)}"

    def build(self, name: str, series: tuple[str, ...]) -> WeatherSource:
        return HeardForecasts(name, self, self.key)


WEATHER_KINDS: dict[str, type[WeatherConfig]] = {
    table.model_fields["kind"].default: table for table in (WeatherCsvConfig, OpenMeteoConfig, ZenohWeatherConfig)
}
"""The table of each kind of forecast by the name that the configuration gives it."""
