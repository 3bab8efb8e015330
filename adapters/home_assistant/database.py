"""What Home Assistant's recorder keeps, read from its SQLite database: states for days, hourly statistics for ever.

A state holds until the next one, as long as the recorder was running. The tables are those of schema 32 (release
2023.4) and later: `states`, `states_meta`, `state_attributes`, `recorder_runs`, `statistics`, `statistics_meta`.
"""

import asyncio
import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from difflib import get_close_matches
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adapters.errors import SourceConfigError, SourceError, SourceUnavailable
from adapters.series.database import Database, Points
from adapters.units import SYMBOLS

HOUR = 3600.0

UNITS = SYMBOLS | {unit: unit for unit in ("K", "%", "W", "kW", "MW", "BTU/h", "Wh", "kWh", "MWh", "MJ", "GJ")}
"""What Home Assistant calls the units that Thermogate knows."""

_WORDS = {
    **dict.fromkeys(("on", "heating", "preheating", "open"), 1.0),
    **dict.fromkeys(("off", "idle", "cooling", "drying", "fan", "defrosting", "closed"), 0.0),
}
"""Words that say whether something is at work: of switches, of a thermostat's `hvac_action`, of windows and valves."""

_TABLES = {
    "states": ("states", "states_meta", "state_attributes", "recorder_runs"),
    "statistics": ("statistics", "statistics_meta"),
}

_NAMES = {
    "states": "SELECT entity_id FROM states_meta",
    "statistics": "SELECT statistic_id FROM statistics_meta WHERE source = 'recorder'",
}

_STATES = """
SELECT last_updated_ts, state, shared_attrs FROM states JOIN states_meta USING (metadata_id)
LEFT JOIN state_attributes USING (attributes_id)
WHERE states_meta.entity_id = ? AND last_updated_ts NOT NULL ORDER BY last_updated_ts
"""

_STATISTICS = """
SELECT start_ts, mean, state FROM statistics JOIN statistics_meta ON statistics_meta.id = metadata_id
WHERE statistic_id = ? AND source = 'recorder' ORDER BY start_ts
"""

_UNIT = {
    "states": """
        SELECT json_extract(shared_attrs, '$.unit_of_measurement') FROM states JOIN states_meta USING (metadata_id)
        JOIN state_attributes USING (attributes_id) WHERE states_meta.entity_id = ?
        ORDER BY last_updated_ts DESC LIMIT 1
    """,
    "statistics": "SELECT unit_of_measurement FROM statistics_meta WHERE statistic_id = ? AND source = 'recorder'",
}


class Stretches(NamedTuple):
    """When a value held, m stretches in the order of time."""

    begins: npt.NDArray[np.float64]
    """(m,): UTC s."""
    ends: npt.NDArray[np.float64]
    """(m,): UTC s; the value holds before it."""
    values: npt.NDArray[np.float64]
    """(m,): NaN for what is no number."""


class Recorder(Database):
    """A state holds until the next one, and is read again every `step`, so that an interval's mean weighs it by its
    time; what is no number is missing. Statistics are the means of hours. A counter's value is read when it changes."""

    def __init__(self, table: Any) -> None:
        super().__init__(table)
        self._known: dict[str, Stretches] = {}
        """What the file holds, by the address of a channel."""

    def problems(self, channels: Sequence[Any]) -> list[str]:
        try:
            with self._opened() as connection:
                return _problems(connection, self.table, channels)
        except SourceError as error:
            return [str(error)]

    async def span(self, channels: Sequence[Any]) -> tuple[float, float]:
        """From the first state or hour of any channel until the last has ended; the last state has no length."""
        self._known = await asyncio.to_thread(self._read, channels)
        known = [history for history in self._known.values() if len(history.begins)]
        begin = min((float(history.begins[0]) for history in known), default=0.0)
        return begin, max((float(history.ends[-1]) + 1e-3 for history in known), default=begin)

    async def points(self, channel: Any, begin: float, end: float, counter: bool) -> Points:
        """The values at the beginning of each stretch in [begin, end), and at every whole step while it lasts."""
        history, step = self._known[channel.address], self.table.step
        first, last = np.searchsorted(history.ends, begin, "right"), np.searchsorted(history.begins, end, "left")
        found: list[tuple[float, float]] = []
        for began, ended, value in zip(*(rows[first:last].tolist() for rows in history), strict=True):
            if not isfinite(value):
                continue
            times = [began] if began >= begin else []
            if not counter:
                again = max(began, begin - step) // step * step + step
                times += np.arange(again, min(ended, end), step).tolist()
            found += [(time, value) for time in times]
        return Points(*np.array(found, dtype=np.float64).reshape(-1, 2).T)

    async def newest(self, channel: Any) -> Points:
        history = (await asyncio.to_thread(self._read, [channel]))[channel.address]
        return Points(history.begins, history.values)

    def _read(self, channels: Sequence[Any]) -> dict[str, Stretches]:
        read = _states if self.table.data == "states" else _statistics
        with self._opened() as connection:
            return {channel.address: read(connection, channel) for channel in channels}

    @contextmanager
    def _opened(self) -> Iterator[sqlite3.Connection]:
        """The database, read only. Raises SourceUnavailable, and SourceConfigError for another one."""
        path = self.table.file.resolve()
        if not path.is_file():
            raise SourceUnavailable(
                f"file '{path}' is not there; copy home-assistant_v2.db out of Home Assistant's folder"
            )
        try:
            uri = f"{path.as_uri()}?mode=ro{'&immutable=1' if _is_copied(path) else ''}"
            with closing(sqlite3.connect(uri, uri=True, timeout=10.0)) as connection:
                there = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
                missing = [name for name in _TABLES[self.table.data] if name not in there]
                if missing:
                    raise SourceConfigError(
                        f"file '{path}' has no table {missing[0]}; give the database of Home Assistant 2023.4 or newer"
                    )
                yield connection
        except (sqlite3.Error, OSError) as error:
            raise SourceUnavailable(f"file '{path}' cannot be read as a database of SQLite ({error})") from error


def _is_copied(path: Path) -> bool:
    """Whether the database keeps a write-ahead log and has none, so that nobody has it open: SQLite would write one
    beside it even to read it, which fails in a folder that this account cannot write."""
    with path.open("rb") as file:
        keeps_log = file.read(20)[18:19] == b"\x02"
    return keeps_log and not path.with_name(f"{path.name}-wal").exists()


def _problems(connection: sqlite3.Connection, table: Any, wanted: Sequence[Any]) -> list[str]:
    """One sentence for every entity that is not in the database, or is there in another unit than the one `wanted`."""
    known = [name for (name,) in connection.execute(_NAMES[table.data])]
    found = []
    for channel in wanted:
        entity, unit = channel.entity, channel.stated_unit
        if entity not in known:
            near = get_close_matches(entity, known, 3, 0.4)
            hint = f"did you mean {' or '.join(near)}?" if near else "the recorder may leave it out"
            found.append(f"file '{table.file}' has no {table.data} of '{entity}'; {hint}")
        elif channel.attribute is None:
            (told,) = connection.execute(_UNIT[table.data], (entity,)).fetchone() or (None,)
            if unit and told in UNITS and UNITS[told] != unit:
                found.append(f'\'{entity}\' is in {told}; write unit = "{UNITS[told]}" instead of "{unit}"')
    return found


def _states(connection: sqlite3.Connection, channel: Any) -> Stretches:
    """The states of the entity of `channel`, each until the next one or until the recorder stopped."""
    rows = connection.execute(_STATES, (channel.entity,)).fetchall()
    begins = np.array([row[0] for row in rows], dtype=np.float64)
    values = np.array(
        [_number(channel.attribute, state, attributes) for _, state, attributes in rows], dtype=np.float64
    )
    ends = np.append(begins[1:], inf)
    for began, stopped in _runs(connection):
        # What holds when the recorder stops is not known to hold until it starts again.
        inside = (begins >= began) & (begins < stopped)
        ends[inside] = np.minimum(ends[inside], stopped)
    (newest,) = connection.execute("SELECT max(last_updated_ts) FROM states").fetchone()
    # Nothing is known of the time after the newest state of any entity.
    return Stretches(begins, np.minimum(ends, newest or 0.0), values)


def _statistics(connection: sqlite3.Connection, channel: Any) -> Stretches:
    """Hourly means; of a meter what it showed at the end of each hour, from then on for an hour."""
    rows = connection.execute(_STATISTICS, (channel.entity,)).fetchall()
    metered = [mean is None for _, mean, _ in rows]
    begins = np.array([row[0] for row in rows], dtype=np.float64) + HOUR * np.array(metered, dtype=np.float64)
    told = [state if mean is None else mean for _, mean, state in rows]
    return Stretches(begins, begins + HOUR, np.array([nan if one is None else one for one in told], dtype=np.float64))


def _number(attribute: str | None, state: str | None, attributes: str | None) -> float:
    if attribute is None:
        return as_number(state)
    try:
        known = json.loads(attributes or "{}")
    except (ValueError, RecursionError):
        return nan
    return as_number(known.get(attribute)) if isinstance(known, dict) else nan


def as_number(told: object) -> float:
    """The number that a state or an attribute is; of a word that says whether something is at work 1 or 0, else NaN."""
    if isinstance(told, str) and told in _WORDS:
        return _WORDS[told]
    try:
        value = float(told)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return nan
    return value if isfinite(value) else nan


def _runs(connection: sqlite3.Connection) -> list[tuple[float, float]]:
    """When the recorder was running, UTC s; a run that has not ended goes on."""
    rows = connection.execute('SELECT start, "end" FROM recorder_runs ORDER BY start').fetchall()
    return [(_seconds(start), inf if end is None else _seconds(end)) for start, end in rows]


def _seconds(text: str) -> float:
    return datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()
