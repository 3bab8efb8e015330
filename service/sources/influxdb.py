"""Sources of kind "influxdb": the history in InfluxDB."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from adapters.series.database import InfluxDB, parts
from adapters.series.source import SeriesSource
from service.fields.values import Text, text
from service.sources.channel import Binding, SourceKind
from service.sources.series import SeriesChannelConfig, SeriesConfig, series_source


def query(value: object) -> str:
    """Field, measurement and condition, as InfluxQL writes them."""
    parts(text(value))
    return str(value)


class InfluxConfig(SeriesConfig):
    """[sources.<name>] of kind "influxdb"."""

    kind: Literal["influxdb"] = "influxdb"
    database: Text = Field(description="the name of the database; of the bucket in version 2")


class InfluxChannelConfig(SeriesChannelConfig):
    """A channel of InfluxDB: the raw value is the mean of a field."""

    query: Annotated[str, BeforeValidator(query)] = Field(
        description="field, measurement and condition, such as '\"value\" FROM \"degC\" WHERE \"room\" = ''101'''"
    )


def _build(name: str, table: InfluxConfig, bindings: Sequence[Binding]) -> SeriesSource:
    return series_source(name, table, InfluxDB(table.server, table.database), bindings)


KIND = SourceKind("influxdb", InfluxConfig, InfluxChannelConfig, False, 'query = \'"value" FROM "degC"\'', _build)
