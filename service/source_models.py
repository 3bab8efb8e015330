"""What every kind of source and channel has in the configuration, and the tables of recorded CSV files."""

from __future__ import annotations

from pathlib import PurePath
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, Field, model_validator

from service.config_types import (
    Delimiter,
    Duration,
    Encoding,
    FilePath,
    NonZero,
    Number,
    Pace,
    Positive,
    Range,
    Text,
    TimestampFormat,
    TimeZone,
    choice,
)
from service.network_models import TABLE


class ChannelConfig(BaseModel):
    """What a channel says whatever its source is: network value = raw value * scale + offset, converted from `unit`.

    Every kind of source adds where the raw value is found there.
    """

    model_config = TABLE

    source: Text = Field(description="the name of the [sources.<name>] table that delivers it")
    unit: Text = Field(description='the unit of the value after scale and offset, such as "degC" or "kW"')
    scale: NonZero = 1.0
    offset: Number = 0.0
    nominal: Positive | None = None
    rollover: Positive | None = None
    aggregate: Text = "mean"
    valid: Range | None = Field(
        default=None, description="two numbers, the smallest and the largest believable value in the network's unit"
    )
    max_age: Duration | None = None

    @property
    def address(self) -> str:
        """Where the value is found at its source, in the operator's words."""
        return ""

    def within(self, table: Any) -> Self:
        """This channel with what it takes over from `table`, its source; ValueError with one sentence if it then
        cannot be read."""
        return self


class UnboundChannel(ChannelConfig):
    """A channel whose source is not known: what depends on the kind of source is passed over."""

    model_config = TABLE | {"extra": "ignore"}


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

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""
        count = len(self.files)
        return f"{count} file{'' if count == 1 else 's'} ({', '.join(PurePath(file).name for file in self.files)})"


class CsvChannelConfig(ChannelConfig):
    """A channel of recorded files: the raw value is a column, or the sum of several."""

    column: Text | None = None
    columns: tuple[Text, ...] | None = Field(
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
        return " + ".join(self.source_columns)
