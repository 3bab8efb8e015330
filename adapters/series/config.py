"""The tables of kinds "prometheus" and "influxdb": histories in databases of time series."""

from typing import Annotated, ClassVar, Literal

from pydantic import BeforeValidator, Field, PlainSerializer

from adapters.channel import ChannelConfig, RecordedConfig
from adapters.fields.addresses import web_address
from adapters.fields.logins import LoginConfig
from adapters.fields.times import ZoneMissing, parse_time, written_time
from adapters.fields.values import PositiveDuration, Text, text
from adapters.series.database import Server, parts


def moment(value: object) -> float:
    """UTC s of a time in RFC 3339."""
    try:
        return parse_time(text(value)).timestamp()
    except ZoneMissing:
        raise ValueError(f'"{value}" has no time zone; end it with Z for UTC or an offset such as +02:00') from None
    except ValueError:
        raise ValueError(f'"{str(value)[:60]}" is not a time; write it as "2026-01-01T00:00:00Z"') from None


Moment = Annotated[float, BeforeValidator(moment), PlainSerializer(written_time, return_type=str)]


class SeriesChannelConfig(ChannelConfig):
    """A channel of a database of time series: the raw values are those of a series."""

    query: Text = Field(description="what the database is asked for")

    @property
    def address(self) -> str:
        return self.query


class HistoryConfig(RecordedConfig):
    """What the table of every database has that is asked for a stretch of time."""

    source: ClassVar = "adapters.series.source:SeriesSource"
    asked: ClassVar[str]
    """The class of the database, as module:class."""

    begin: Moment = Field(description='the first time to read, such as "2026-01-01T00:00:00Z"')
    end: Moment | None = Field(default=None, description="time to stop before; none: now")
    step: PositiveDuration = Field(default=60.0, description="time from one reading to the next")


class SeriesConfig(LoginConfig, HistoryConfig):
    """What every table of a database over HTTP has."""

    connects: ClassVar = True

    url: Annotated[str, BeforeValidator(web_address("http://127.0.0.1:9090"))] = Field(
        description='the address of the database, such as "http://127.0.0.1:9090"'
    )

    @property
    def described(self) -> str:
        return f"{self.url}, from {written_time(self.begin)}"

    @property
    def server(self) -> Server:
        return Server(self.url, self)


class PrometheusConfig(SeriesConfig):
    """[sources.<name>] of kind "prometheus": Prometheus, VictoriaMetrics and others with its range queries."""

    channel: ClassVar = SeriesChannelConfig
    asked: ClassVar = "adapters.series.database:Prometheus"
    example: ClassVar = 'query = "..."'

    kind: Literal["prometheus"] = "prometheus"


def influx_query(value: object) -> str:
    """Field, measurement and condition, as InfluxQL writes them."""
    parts(text(value))
    return str(value)


class InfluxChannelConfig(SeriesChannelConfig):
    """A channel of InfluxDB: the raw value is the mean of a field, of a counter its first value in each step."""

    query: Annotated[str, BeforeValidator(influx_query)] = Field(
        description="field, measurement and condition, such as '\"value\" FROM \"degC\" WHERE \"room\" = ''101'''"
    )


class InfluxConfig(SeriesConfig):
    """[sources.<name>] of kind "influxdb": InfluxDB, versions 1 to 3."""

    channel: ClassVar = InfluxChannelConfig
    asked: ClassVar = "adapters.series.database:InfluxDB"
    example: ClassVar = 'query = \'"value" FROM "degC"\''

    kind: Literal["influxdb"] = "influxdb"
    database: Text = Field(description="the name of the database; of the bucket in version 2")
