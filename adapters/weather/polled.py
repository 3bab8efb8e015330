"""Forecasts that are looked up: a file that is written anew, or an address."""

from __future__ import annotations

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
from adapters.weather.forecast import WeatherForecast, series_of

_TIMEOUT = 20.0
"""How long an address may take to answer, in s."""


Read = Callable[[Path, float], WeatherForecast]
"""The forecast in a file that was written at UTC s."""


class PolledFile:
    """A file that `read` turns into a forecast; it is issued when it was written."""

    def __init__(
        self,
        name: str,
        path: Path,
        every: float,
        read: Callable[[Path, float], WeatherForecast],
        problems: Sequence[str],
    ) -> None:
        """Looked at `every` s; `problems` are known of it beforehand."""
        self.name = name
        self._path, self._every, self._read, self._problems = path, every, read, list(problems)

    def check(self) -> list[str]:
        """What is known to be wrong."""
        return self._problems

    async def forecasts(self) -> AsyncIterator[WeatherForecast]:
        """The file, and again whenever it has changed."""
        before: tuple[int, int] | None = None
        while True:
            try:
                seen = self._path.stat()
                stamp = (seen.st_mtime_ns, seen.st_size)
                if stamp != before:
                    yield await asyncio.to_thread(self._read, self._path, seen.st_mtime)
                    before = stamp
            except OSError as error:
                reason = (error.strerror or str(error)).lower()
                raise SourceUnavailable(f"weather.{self.name}: {self._path} cannot be read ({reason})") from error
            except SourceError as error:
                raise SourceUnavailable(f"weather.{self.name}: {error}") from error
            await asyncio.sleep(self._every)

    async def close(self) -> None:
        """Nothing is held."""


class PolledAddress:
    """A document at an HTTP address; it is issued when it is fetched, unless it says otherwise."""

    def __init__(self, name: str, url: str, every: float) -> None:
        self.name = name
        self._url, self._every = url, every

    def check(self) -> list[str]:
        """Nothing: an address is tried when the daemon runs."""
        return []

    async def forecasts(self) -> AsyncIterator[WeatherForecast]:
        """The document, fetched again and again."""
        while True:
            try:
                yield parse(await asyncio.to_thread(self._fetched), time.time())
            except SourceError as error:
                raise SourceUnavailable(f"weather.{self.name}: {error}") from error
            await asyncio.sleep(self._every)

    async def close(self) -> None:
        """Nothing is held."""

    def _fetched(self) -> bytes:
        try:
            with urllib.request.urlopen(self._url, timeout=_TIMEOUT) as answer:
                body: bytes = answer.read(LONGEST + 1)
                return body
        except urllib.error.HTTPError as error:
            with error:
                raise SourceUnavailable(f"the address answers {error.code} {error.reason}; check url") from error
        except (OSError, ValueError, HTTPException) as error:
            reason = getattr(error, "reason", None) or error
            raise SourceUnavailable(f"the address cannot be reached ({reason}); check url and network") from error


def csv_file(
    name: str, path: Path, every: float, layout: LayoutConfig, means: str, columns: Sequence[str]
) -> PolledFile:
    """A CSV file with a time and the series in `columns`."""
    channels = [CsvChannel(column, (column,)) for column in columns]

    def read(path: Path, written: float) -> WeatherForecast:
        table = read_table(path, channels, layout)
        series = {
            channel.id: series_of(table.times, values, "", means)
            for channel, values in zip(channels, table.values, strict=True)
        }
        return WeatherForecast(written, series)

    problems: list[str] = []
    # A forecast that is not there yet may come while the daemon runs.
    if path.exists():
        try:
            problems = column_problems(path, read_header(path, layout), channels, layout)
        except SourceError as error:
            problems = [str(error)]
    return PolledFile(name, path, every, read, [f"weather.{name}: {problem}" for problem in problems])


def json_file(name: str, path: Path, every: float) -> PolledFile:
    """A JSON document in a file."""

    def read(path: Path, written: float) -> WeatherForecast:
        # A byte more than is allowed, so that `parse` refuses a longer file without its having been read.
        with path.open("rb") as file:
            return parse(file.read(LONGEST + 1), written)

    return PolledFile(name, path, every, read, ())
