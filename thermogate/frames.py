"""pandas: tables of measurements in, tables of results out."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime, timezone, tzinfo
from math import inf
from typing import Any, NamedTuple

import numpy as np

from adapters.channel import ChannelConfig
from adapters.edge import Converter, Edge
from adapters.errors import SourceError
from adapters.fields.durations import DAY, format_duration
from adapters.fields.words import shown, suggestion
from adapters.reading import Fault, Reading
from adapters.timestamps import local_to_utc, time_zone
from estimator.arrays import Array
from service.errors import DataError

Frame = Any
"""A pandas DataFrame; pandas has no types of its own."""

_ROWS_AT_ONCE = 512
_MOST_NAMES = 30
_UTC = "UTC"
_OFFSET = re.compile(r"UTC([+-](?:[01]\d|2[0-3]):[0-5]\d)")


class Clock(NamedTuple):
    """When the rows of a table are: UTC seconds (K,), NaN where spring skips a local time, and the table's zone."""

    seconds: Array
    zone: str


class Column(NamedTuple):
    """What is read from one column of a table, or from the sum of several."""

    name: str
    """What a person calls it: a channel of the network, or the set-point."""
    address: str
    """The same to an alignment: zone/channel."""
    channel: ChannelConfig
    unit: str
    """The network's."""

    @property
    def sources(self) -> tuple[str, ...]:
        """The columns of a table that it is read from."""
        return self.channel.source_columns  # type: ignore[attr-defined]

    @property
    def edge(self) -> Edge:
        """From the column's unit to the network's."""
        return self.channel.edge(self.unit)


class Part(NamedTuple):
    """Readings of some rows in a row, and the time of the last of these, UTC seconds."""

    readings: list[Reading]
    now: float


def pandas() -> Any:
    """The module; ImportError with one sentence where it is not installed."""
    try:
        import pandas
    except ImportError:
        raise ImportError('pandas is not installed; install it with: pip install "thermogate[pandas]"') from None
    return pandas


def clock(frame: Frame, zone: str | tzinfo | None, what: str) -> Clock:
    """When the rows of `frame`, called `what` in messages, are; `zone` is that of times without one. DataError where
    `frame` is no DataFrame, its index no times, or `zone` cannot be told by a name."""
    pd = pandas()
    if not isinstance(frame, pd.DataFrame):
        raise DataError(f"{what} must be a pandas DataFrame, not {_kind(frame)}")
    if not isinstance(frame.index, pd.DatetimeIndex):
        times, numeric = "df.index", pd.api.types.is_numeric_dtype
        if numeric(frame.index.dtype):
            # The numbers of rows would become nanoseconds of 1970.
            columns = [name for name, kind in frame.dtypes.items() if not numeric(kind)]
            times = f'df["{columns[0]}"]' if columns else 'df.index, unit="s"'
        raise DataError(
            f"the index of {what} holds {frame.index.dtype}, not times; make it one with "
            f"df.index = pd.to_datetime({times})"
        )
    if not len(frame):
        raise DataError(f"{what} has no rows")
    if frame.index.isna().any():
        row = int(frame.index.isna().argmax())
        raise DataError(f"row {row} of {what} has no time (NaT); leave such rows out with df[df.index.notna()]")
    given = None if zone is None else _given_name(zone)
    local = None if given is None else named_zone(given)
    seconds = frame.index.as_unit("us").asi8 / 1e6
    if frame.index.tz is not None:
        return Clock(seconds, given or _zone_name(frame.index.tz) or _UTC)
    if local is None or given is None:
        raise DataError(
            f'the times of {what} have no time zone; give tz, such as tz="Europe/Berlin" for local time or tz="UTC"'
        )
    return Clock(local_to_utc(seconds, local), given)


def _given_name(zone: object) -> str:
    """The name of `zone`, as the caller gave it; DataError if it is no time zone, or one without a name."""
    if isinstance(zone, str):
        return zone
    if not isinstance(zone, tzinfo):
        raise DataError(f'tz must be a time zone such as "Europe/Berlin", not {_kind(zone)}')
    name = _zone_name(zone)
    if name is None:
        why = "is no whole number of minutes from UTC" if isinstance(zone, timezone) else "has no name"
        raise DataError(
            f'tz: the time zone {zone} {why}; give a name such as "Europe/Berlin" or an offset such as "UTC+02:00"'
        )
    return name


def _zone_name(zone: tzinfo) -> str | None:
    """The name by which pandas finds `zone` again; None for a zone that has none."""
    if isinstance(zone, timezone):
        # Its own name can be any text, even that of a zone with other offsets, such as "CET".
        offset = str(timezone(zone.utcoffset(None)))
        return offset if offset == _UTC or _OFFSET.fullmatch(offset) else None
    # zoneinfo has a key, pytz a zone.
    name = getattr(zone, "key", None) or getattr(zone, "zone", None)
    return name if isinstance(name, str) else None


def named_zone(name: str) -> Any:
    """The time zone called `name`, an IANA name or UTC+hh:mm; DataError if there is none."""
    if offset := _OFFSET.fullmatch(name):
        return datetime.strptime(offset[1], "%z").tzinfo
    try:
        return time_zone(name)
    except SourceError as error:
        raise DataError(f"tz: {error}") from None


def spacing(seconds: Array) -> float:
    """The time between two rows of a table, s; DataError where most rows have another distance."""
    steps = np.diff(np.unique(seconds[np.isfinite(seconds)]))
    if not len(steps):
        raise DataError('the table has one row, from which no period follows; give period, such as period="15min"')
    found, counts = np.unique(np.round(steps, 3), return_counts=True)
    usual = float(found[counts.argmax()])
    if counts.max() * 2 < len(steps) or usual < 1.0 or usual != int(usual) or DAY % usual:
        raise DataError(
            f"the rows are {format_duration(float(steps.min()))} to {format_duration(float(steps.max()))} apart, from "
            'which no period follows; give period, such as period="15min"'
        )
    return usual


def check_columns(frame: Frame, columns: Iterable[Column], what: str) -> None:
    """DataError with one sentence for every column that `columns` need and `frame` does not have exactly once."""
    present, problems = [str(name) for name in frame.columns], []
    for column in columns:
        for name in column.sources:
            if present.count(name) > 1:
                problems.append(f"{what} has the column {shown(name)} more than once; rename all but one")
            elif name not in present:
                known = suggestion(name, present[:_MOST_NAMES], "its columns are")
                problems.append(
                    f"{what} has no column {shown(name)} for {column.name} [{column.unit}]; {known}; say which one it "
                    f'is with columns={{"{column.name}": "..."}}'
                )
    if problems:
        raise DataError("\n".join(problems))


def numbers(frame: Frame, name: str, what: str) -> Array:
    """The column `name` (K,), NaN where a cell is empty; DataError for a cell that is no number."""
    pd = pandas()
    (place,) = (i for i, column in enumerate(frame.columns) if str(column) == name)
    series = frame.iloc[:, place]
    found = pd.to_numeric(series, errors="coerce")
    wrong = (found.isna() & series.notna()).to_numpy()
    if wrong.any() or not pd.api.types.is_numeric_dtype(found.dtype) or np.iscomplexobj(found.to_numpy()):
        row = int(wrong.argmax())
        raise DataError(
            f"{what}: column {shown(name)} holds {shown(str(series.iloc[row]))} at {series.index[row]}, which is no "
            f'number; convert the column with pd.to_numeric(df["{name}"], errors="coerce")'
        )
    return np.asarray(found.to_numpy(dtype=np.float64, na_value=np.nan))


class Reader:
    """The readings of a table of measurements, in the order of time."""

    def __init__(self, frame: Frame, times: Clock, columns: Sequence[Column], since: float = -inf) -> None:
        """Readings before `since`, UTC s, are passed over, and their faults too."""
        self.faults: Counter[Fault] = Counter()
        """Readings whose local time spring skips; an alignment counts the others."""
        self._first: dict[tuple[str, Fault], str] = {}
        self._refused: Counter[tuple[str, Fault]] = Counter()
        self._order = np.argsort(times.seconds, kind="stable")[: int(np.isfinite(times.seconds).sum())]
        if lost := _lost(frame, times, since):
            self.faults[Fault.BAD_TIMESTAMP] = lost * len(columns)
        self._frame, self._seconds, self._since = frame, times.seconds, since
        self._columns = [(one, _summed(frame, one), Converter(one.address, one.edge)) for one in columns]

    def parts(self) -> Iterator[Part]:
        """The readings, some hundred rows at once, but for empty cells. A meter begins with the first row, passed over
        or not."""
        for begin in range(0, len(self._order), _ROWS_AT_ONCE):
            rows = self._order[begin : begin + _ROWS_AT_ONCE]
            times, readings = self._seconds[rows].tolist(), []
            for column, values, converter in self._columns:
                for row, time, value in zip(rows.tolist(), times, values[rows].tolist(), strict=True):
                    reading = None if np.isnan(value) else converter.reading(time, value)
                    if reading is not None and reading.time >= self._since:
                        readings.append(reading)
                        if reading.fault is not None:
                            self._note(column, reading.fault, row, value)
            yield Part(readings, times[-1])

    def last(self) -> float:
        """The last time, UTC seconds; DataError where no row has one."""
        if not len(self._order):
            raise DataError("the clock change in spring skips every time of the table; is tz the right one?")
        return float(self._seconds[self._order[-1]])

    def refused(self, faults: Counter[Fault]) -> list[str]:
        """One sentence for every column with values that were not used, and for the other `faults`."""
        others = Counter(faults)
        for (_, fault), count in self._refused.items():
            others[fault] -= count
        sentences = [f"the table: {count} readings not used ({_words(fault)})" for fault, count in (+others).items()]
        named = {column.name: column for column, _, _ in self._columns}
        return sentences + [
            f"column {shown(' + '.join(named[name].sources))}: {count} "
            f"{'value' if count == 1 else 'values'} not used ({_words(fault)}), the first "
            f"{self._first[name, fault]}; is {shown(named[name].channel.unit)} the right unit for {name}?"
            for (name, fault), count in self._refused.items()
        ]

    def _note(self, column: Column, fault: Fault, row: int, value: float) -> None:
        self._refused[column.name, fault] += 1
        self._first.setdefault((column.name, fault), f"{value:g} at {self._frame.index[row]}")


def _lost(frame: Frame, times: Clock, since: float) -> int:
    """How many rows have a local time that spring skips, and are not before `since`, UTC s."""
    lost = np.isnan(times.seconds)
    if lost.any() and since > -inf:
        # Such a time is no moment. It comes after the local time that was just before `since`.
        before = moments([since - 1.0], times.zone)[0].tz_localize(None)
        lost = lost & np.asarray(frame.index > before)
    return int(lost.sum())


def _summed(frame: Frame, column: Column) -> Array:
    first, *others = (numbers(frame, name, "the table") for name in column.sources)
    total: Array = first
    for values in others:
        total = total + values
    return total


def moments(seconds: Sequence[float] | Array, zone: str) -> Any:
    """UTC seconds as a DatetimeIndex in `zone`, called "time"."""
    pd = pandas()
    whole = np.asarray(seconds, dtype=np.float64).astype(np.int64)
    return pd.DatetimeIndex(pd.to_datetime(whole, unit="s", utc=True)).tz_convert(zone).rename("time")


def table(columns: Mapping[Any, Any], index: Any) -> Frame:
    """A DataFrame of `columns` (K,); keys that are pairs become two rows of headings."""
    pd = pandas()
    frame = pd.DataFrame(dict(columns), index=index)
    if columns and all(isinstance(key, tuple) for key in columns):
        frame.columns = pd.MultiIndex.from_tuples(list(columns))
    return frame


def _words(fault: Fault) -> str:
    return str(fault).replace("_", " ")


def _kind(value: object) -> str:
    name = type(value).__name__
    return f"{'an' if name[0].lower() in 'aeiou' else 'a'} {name}"
