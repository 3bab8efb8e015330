"""The tables of kind "csv": recorded files."""

from pathlib import PurePath
from typing import Annotated, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from adapters.channel import ChannelConfig, RecordedConfig
from adapters.fields.tables import Table
from adapters.fields.values import Column, Delimiter, Encoding, FilePath, TimestampFormat, TimeZone, choice


class TimestampConfig(Table):
    """`timestamp`: the column that holds the time, how it is written, and the zone of times without offset."""

    column: Column = Field(description='the name of the timestamp column, such as "Timestamp"')
    format: TimestampFormat = Field(
        default="iso8601", description='`"iso8601"`, `"epoch"` (s since 1970) or a strptime pattern'
    )
    zone: TimeZone | None = Field(default=None, description="zone of times without offset; none: they are faults")


class LayoutConfig(Table):
    """How a file is written."""

    timestamp: TimestampConfig = Field(
        description='a table such as { column = "Timestamp", format = "iso8601", zone = "Europe/Berlin" }'
    )
    delimiter: Delimiter = Field(default=",", description="separator of columns")
    decimal: Annotated[str, BeforeValidator(choice(".", ","))] = Field(default=".", description="decimal mark")
    encoding: Encoding = Field(default="utf-8", description='text encoding, such as `"cp1252"`')

    @model_validator(mode="after")
    def _readable(self) -> Self:
        if self.delimiter == self.decimal:
            raise ValueError(f'delimiter and decimal are both "{self.decimal}"; they must differ')
        return self


class CsvChannelConfig(ChannelConfig):
    """A channel of recorded files: the raw value is a column, or the sum of several."""

    column: Column | None = Field(default=None, description='name of the column; `""`: one without a name')
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
        return (self.column,) if self.column is not None else self.columns or ()

    @property
    def address(self) -> str:
        return " + ".join(column or "(unnamed)" for column in self.source_columns)


class CsvConfig(LayoutConfig, RecordedConfig):
    """[sources.<name>] of kind "csv": recorded files, read in order."""

    channel: ClassVar = CsvChannelConfig
    example: ClassVar = 'column = "..."'
    source: ClassVar = "adapters.csv.source:CsvSource"

    kind: Literal["csv"] = "csv"
    files: tuple[FilePath, ...] = Field(
        min_length=1, description='the list of files to read in order, such as ["a.csv", "b.csv.gz"]'
    )
    follow: bool = Field(default=False, description="whether the last file grows, and what is appended counts too")

    @model_validator(mode="after")
    def _can_grow(self) -> Self:
        kind = self.files[-1].suffix.lower()
        if self.follow and kind in (".gz", ".parquet"):
            raise ValueError(f"follow reads a file that grows, and a {kind} file cannot; name the file itself last")
        return self

    @property
    def described(self) -> str:
        count = len(self.files)
        return f"{count} file{'' if count == 1 else 's'} ({', '.join(PurePath(file).name for file in self.files)})"
