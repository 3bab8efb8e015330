"""Forecasts that are looked up: a file that is written anew, or an address."""

import asyncio
import time
import urllib.error
import urllib.request
from collections.abc import AsyncIterator, Callable, Sequence
from http.client import HTTPException
from pathlib import Path

from adapters.csv.config import LayoutConfig
from adapters.csv.table import CsvChannel, column_problems, read_header, read_table
from adapters.errors import SourceError, SourceUnavailable
from adapters.weather.document import LONGEST, parse
from adapters.weather.forecast import WeatherForecast, WeatherSource, series_of

_TIMEOUT = 20.0
"""How long an address may take to answer, in s."""


class PolledForecasts(WeatherSource):
    """What `read` finds, looked up every `every` s, and read again where its `stamp` has changed."""

    def __init__(
        self,
        name: str,
        every: float,
        read: Callable[[], WeatherForecast],
        stamp: Callable[[], object] = time.monotonic,
        problems: Sequence[str] = (),
    ) -> None:
        """`problems` are known of it beforehand."""
        self.name = name
        self._every, self._read, self._stamp = every, read, stamp
        self._problems = [f"weather.{name}: {problem}" for problem in problems]

    def check(self) -> list[str]:
        return self._problems

    async def forecasts(self) -> AsyncIterator[WeatherForecast]:
        before: object = None
        while True:
            try:
                if (stamp := self._stamp()) != before:
                    yield await asyncio.to_thread(self._read)
                    before = stamp
            except OSError as error:
                reason = (error.strerror or str(error)).lower()
                what = error.filename or "the file"
                raise SourceUnavailable(f"weather.{self.name}: {what} cannot be read ({reason})") from error
            except SourceError as error:
                raise SourceUnavailable(f"weather.{self.name}: {error}") from error
            await asyncio.sleep(self._every)


def _written(path: Path) -> tuple[int, int]:
    """When the file at `path` was written, and how long it is."""
    seen = path.stat()
    return seen.st_mtime_ns, seen.st_size


def csv_file(
    name: str, path: Path, every: float, layout: LayoutConfig, means: str, columns: Sequence[str]
) -> PolledForecasts:
    """A CSV file with a time and the series in `columns`, issued when it was written."""
    channels = [CsvChannel(column, (column,)) for column in columns]

    def read() -> WeatherForecast:
        table = read_table(path, channels, layout)
        pairs = zip(columns, table.values, strict=True)
        series = {name: series_of(table.times, values, "", means) for name, values in pairs}
        return WeatherForecast(path.stat().st_mtime, series)

    problems: list[str] = []
    # A forecast that is not there yet may come while the daemon runs.
    if path.exists():
        try:
            problems = column_problems(path, read_header(path, layout), channels, layout)
        except SourceError as error:
            problems = [str(error)]
    return PolledForecasts(name, every, read, lambda: _written(path), problems)


def json_file(name: str, path: Path, every: float) -> PolledForecasts:
    """A JSON document in a file, issued when it was written unless it says otherwise."""

    def read() -> WeatherForecast:
        # A byte more than is allowed, so that `parse` refuses a longer file without its having been read.
        with path.open("rb") as file:
            return parse(file.read(LONGEST + 1), path.stat().st_mtime)

    return PolledForecasts(name, every, read, lambda: _written(path))


def json_address(name: str, url: str, every: float) -> PolledForecasts:
    """A JSON document at an HTTP address, issued when it is fetched unless it says otherwise."""

    def read() -> WeatherForecast:
        try:
            with urllib.request.urlopen(url, timeout=_TIMEOUT) as answer:
                return parse(answer.read(LONGEST + 1), time.time())
        except urllib.error.HTTPError as error:
            with error:
                raise SourceUnavailable(f"the address answers {error.code} {error.reason}; check url") from error
        except (OSError, ValueError, HTTPException) as error:
            reason = getattr(error, "reason", None) or error
            raise SourceUnavailable(f"the address cannot be reached ({reason}); check url and network") from error

    return PolledForecasts(name, every, read)
