"""Sources of kind "csv": recorded files."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from pathlib import PurePath
from typing import Annotated, Literal, Self

from pydantic import BaseModel, BeforeValidator, Field, model_validator

from adapters.csv.source import CsvChannel, CsvSource
from service.fields.tables import TABLE
from service.fields.values import Column, Delimiter, Encoding, FilePath, Pace, TimestampFormat, TimeZone, choice
from service.sources.channel import Binding, ChannelConfig, SourceKind, edge_of


class TimestampConfig(BaseModel):
    """Which column holds the time, how it is written, and the time zone of naive times."""

    model_config = TABLE

    column: Column = Field(description='the name of the timestamp column, such as "Timestamp"')
    format: TimestampFormat = "iso8601"
    zone: TimeZone | None = None


def require_distinct(delimiter: str, decimal: str) -> None:
    """Raises ValueError where what separates the columns also marks decimals."""
    if delimiter == decimal:
        raise ValueError(f'delimiter and decimal are both "{decimal}"; they must differ')


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
        require_distinct(self.delimiter, self.decimal)
        return self

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""
        count = len(self.files)
        return f"{count} file{'' if count == 1 else 's'} ({', '.join(PurePath(file).name for file in self.files)})"


class CsvChannelConfig(ChannelConfig):
    """A channel of recorded files: the raw value is a column, or the sum of several."""

    column: Column | None = None
    columns: tuple[Column, ...] | None = Field(
        default=None, description='a list of columns to add up, such as ["my-pv1", "my-pv2"]'
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

    @property
    def address(self) -> str:
        """The columns."""
        return " + ".join(column or "(unnamed)" for column in self.source_columns)


def _build(name: str, table: CsvConfig, bindings: Sequence[Binding]) -> CsvSource:
    return CsvSource(
        name,
        table.files,
        [_channel(binding.id, binding.channel, binding.unit) for binding in bindings],
        timestamp_column=table.timestamp.column,
        timestamp_format=table.timestamp.format,
        zone=table.timestamp.zone,
        delimiter=table.delimiter,
        decimal=table.decimal,
        encoding=table.encoding,
        pace=None if table.pace == inf else table.pace,
    )


def _channel(id: str, channel: CsvChannelConfig, unit: str) -> CsvChannel:
    return CsvChannel(id, channel.source_columns, edge_of(channel, unit))


KIND = SourceKind("csv", CsvConfig, CsvChannelConfig, False, 'column = "..."', _build)
