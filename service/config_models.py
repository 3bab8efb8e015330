"""The configuration as the daemon sees it: every table of the TOML file as a frozen model with its defaults.

`service.config.load` builds a `Config`; nothing else needs to. Descriptions complete the sentences
"is missing; give ..." and "must be ...".
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, Field, ValidationInfo, model_validator

from service.config_types import (
    Delimiter,
    Duration,
    Encoding,
    Endpoint,
    FilePath,
    Flag,
    Identifier,
    Levels,
    LoopbackEndpoint,
    LoopbackHost,
    NonZero,
    Number,
    Pace,
    Period,
    PositiveDuration,
    Range,
    Text,
    TimestampFormat,
    TimeZone,
    choice,
    context,
    whole,
)
from service.network_models import TABLE, NetworkConfig

Port = Annotated[int, BeforeValidator(whole(0, 65535))]
Mode = Annotated[Literal["peer", "client", "router"], BeforeValidator(choice("peer", "client", "router"))]


class SiteConfig(BaseModel):
    """[site]: who this is, and where state is kept."""

    model_config = TABLE

    id: Identifier = Field(description='the name of the site, such as "htwg"')
    state_dir: FilePath = Field(default=Path("var/thermogate"), validate_default=True)
    checkpoint_every: PositiveDuration = 300.0


class HttpConfig(BaseModel):
    """[http]: where REST is served; port 0 is any free one."""

    model_config = TABLE

    host: LoopbackHost = "127.0.0.1"
    port: Port = 8080


class ZenohConfig(BaseModel):
    """[zenoh]: the daemon's own session."""

    model_config = TABLE

    enabled: Flag = True
    mode: Mode = "peer"
    listen: tuple[LoopbackEndpoint, ...] = Field(
        default=("tcp/127.0.0.1:7447",), description='a list of endpoints, such as ["tcp/127.0.0.1:7447"]'
    )
    connect: tuple[Endpoint, ...] = Field(default=(), description='a list of endpoints, such as ["tcp/127.0.0.1:7448"]')
    await_subscriber: Duration = 0.0

    @model_validator(mode="after")
    def _client_has_a_router(self) -> Self:
        if self.enabled and self.mode == "client" and not self.connect:
            raise ValueError('mode "client" needs a router to connect to; list it in connect, or use mode "peer"')
        return self


class TimestampConfig(BaseModel):
    """Which column holds the time, how it is written, and the time zone of naive times."""

    model_config = TABLE

    column: Text = Field(description='the name of the timestamp column, such as "Timestamp"')
    format: TimestampFormat = "iso8601"
    zone: TimeZone | None = None


class CsvConfig(BaseModel):
    """[sources.<name>] of kind "csv": recorded files, read in order."""

    model_config = TABLE

    kind: Literal["csv"] = "csv"
    files: tuple[FilePath, ...] = Field(
        min_length=1, description='the list of files to read in order, such as ["a.csv", "b.csv.gz"]'
    )
    delimiter: Delimiter = ","
    decimal: Annotated[str, BeforeValidator(choice(".", ","))] = "."
    encoding: Encoding = "utf-8"
    timestamp: TimestampConfig = Field(
        description='a table such as { column = "Timestamp", format = "iso8601", zone = "Europe/Berlin" }'
    )
    pace: Pace = float("inf")

    @model_validator(mode="after")
    def _readable(self) -> Self:
        if self.delimiter == self.decimal:
            raise ValueError(f'delimiter and decimal are both "{self.decimal}"; they must differ')
        return self


SourceConfig = CsvConfig


class ChannelConfig(BaseModel):
    """One channel of a zone: network value = (sum of columns * scale + offset), converted from `unit`."""

    model_config = TABLE

    source: Text = Field(description="the name of the [sources.<name>] table that delivers it")
    column: Text | None = None
    columns: tuple[Text, ...] | None = Field(
        default=None, description='a list of columns to add up, such as ["my-pv1", "my-pv2"]'
    )
    unit: Text = Field(description='the unit that the column is in, such as "degC" or "kW"')
    scale: NonZero = 1.0
    offset: Number = 0.0
    aggregate: Text = "mean"
    valid: Range | None = Field(
        default=None, description="two numbers, the smallest and the largest believable value in the network's unit"
    )

    @model_validator(mode="after")
    def _one_or_several_columns(self) -> Self:
        if (self.column is None) == (not self.columns):
            raise ValueError("needs either column (one column) or columns (a list of columns to add up)")
        return self

    @property
    def source_columns(self) -> tuple[str, ...]:
        """The columns to add up, one or more."""
        return (self.column,) if self.column is not None else self.columns or ()


def default_seed(site: str, zone: str) -> int:
    """The seed of a zone that gives none: the same on every machine and after every restart."""
    return zlib.crc32(f"{site}/{zone}".encode())


class ZoneConfig(BaseModel):
    """[[zones]]: one thermal zone with its own grid, network and estimator."""

    model_config = TABLE

    id: Identifier = Field(description='the name of the zone, such as "living"')
    period: Period = Field(description='the sampling period, such as "5min"')
    network: NetworkConfig = Field(description='a preset such as "titeth", or a [zones.network] table')
    estimator: Text = "rbpf"
    seed: Annotated[int, BeforeValidator(whole(0, 2**63 - 1))]
    levels: Levels = Field(default=(0.95,), min_length=1, description="a list of levels, such as [0.5, 0.95]")
    max_gap: Annotated[int, BeforeValidator(whole(0, 1_000_000))] = 12
    hold_inputs: Duration = 900.0
    lateness: Duration = 0.0
    estimator_options: dict[str, Any] = Field(default={}, description="a table, such as particles = 9000")
    channels: dict[str, ChannelConfig] = Field(
        description='a table with one line per channel, such as T_i = { source = "bms", column = "Ti", unit = "degC" }'
    )

    @model_validator(mode="before")
    @classmethod
    def _seeded(cls, table: Any, info: ValidationInfo) -> Any:
        if not isinstance(table, dict) or "seed" in table:
            return table
        return table | {"seed": default_seed(str(context(info)["site"]), str(table.get("id")))}


class Config(BaseModel):
    """The whole configuration, every default filled in and every path absolute."""

    model_config = TABLE

    site: SiteConfig
    http: HttpConfig
    zenoh: ZenohConfig
    sources: dict[str, SourceConfig]
    zones: tuple[ZoneConfig, ...]
