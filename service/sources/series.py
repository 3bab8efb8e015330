"""What sources of the kinds "prometheus" and "influxdb" have in common: histories in databases of time series."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Annotated

from pydantic import BeforeValidator, Field, PlainSerializer

from adapters.series.database import Database, Server
from adapters.series.source import SeriesChannel, SeriesSource
from service.fields.addresses import is_web_address
from service.fields.credentials import LoginConfig
from service.fields.times import ZoneMissing, parse_time, written_time
from service.fields.values import Pace, PositiveDuration, Text, text
from service.sources.channel import Binding, ChannelConfig, edge_of


def web_address(value: object) -> str:
    """The address of a server."""
    if not is_web_address(text(value)):
        raise ValueError('must be an address such as "http://127.0.0.1:9090"')
    return str(value)


def moment(value: object) -> float:
    """UTC s of a time in RFC 3339."""
    try:
        return parse_time(text(value)).timestamp()
    except ZoneMissing:
        raise ValueError(f'"{value}" has no time zone; end it with Z for UTC or an offset such as +02:00') from None
    except ValueError:
        raise ValueError(f'"{str(value)[:60]}" is not a time; write it as "2026-01-01T00:00:00Z"') from None


Moment = Annotated[float, BeforeValidator(moment), PlainSerializer(written_time, return_type=str)]


class SeriesConfig(LoginConfig):
    """What every table of such a source has."""

    url: Annotated[str, BeforeValidator(web_address)] = Field(
        description='the address of the database, such as "http://127.0.0.1:9090"'
    )
    begin: Moment = Field(description='the first time to read, such as "2026-01-01T00:00:00Z"')
    end: Moment | None = None
    step: PositiveDuration = 60.0
    pace: Pace = float("inf")

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""
        return f"{self.url}, from {written_time(self.begin)}"

    @property
    def server(self) -> Server:
        """The server, and as whom it is asked."""
        return Server(self.url, self.user, self.password_file, self.password_env)


class SeriesChannelConfig(ChannelConfig):
    """A channel of a database of time series: the raw values are those of a series."""

    query: Text = Field(description="what the database is asked for")

    @property
    def address(self) -> str:
        """The query."""
        return self.query


def series_source(name: str, table: SeriesConfig, database: Database, bindings: Sequence[Binding]) -> SeriesSource:
    """The source of `table`, which asks `database`."""
    channels = [SeriesChannel(one.id, one.channel.query, edge_of(one.channel, one.unit)) for one in bindings]
    pace = None if table.pace == inf else table.pace
    return SeriesSource(name, database, channels, (table.begin, table.end), table.step, pace)
