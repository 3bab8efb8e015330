"""Forecasts of the weather at work: for each source, the task that keeps the newest one in the book."""

import asyncio
from collections.abc import Callable

from adapters.weather.forecast import WeatherSource
from service.config.site import Config
from service.daemon.supply.feeding import persevere
from service.daemon.tasks import end
from service.pauses import GrowingPause
from service.records.outlook import WeatherBook

FIRST_PAUSE = 5.0
LONGEST_PAUSE = 600.0


class WeatherFeeds:
    """The forecasts of a configuration; a reload gives another one."""

    def __init__(self, book: WeatherBook) -> None:
        self._book = book
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._built: dict[str, tuple[object, ...]] = {}

    async def follow(self, config: Config) -> None:
        """Let the sources be those of `config`; one that is the same goes on, unless it has given up."""
        wanted = {name: (table, config.weather_series(name)) for name, table in config.weather.items()}
        gone = [name for name, task in self._tasks.items() if task.done() or self._built[name] != wanted.get(name)]
        await end([self._tasks.pop(name) for name in gone])
        self._book.keep(frozenset(wanted) - frozenset(gone))
        for name in wanted:
            if name not in self._tasks:
                self._built[name] = wanted[name]
                source = config.build_weather(name)
                self._tasks[name] = asyncio.create_task(self._feed(source), name=f"weather {name}")

    async def stop(self) -> None:
        """No forecast comes any more."""
        tasks, self._tasks = list(self._tasks.values()), {}
        await end(tasks)

    async def _feed(self, source: WeatherSource) -> None:
        async def take(came: Callable[[bool], None]) -> None:
            async for forecast in source.forecasts():
                self._book.put(source.name, forecast)
                came(True)

        async def failed(reason: str) -> None:
            """Without a forecast of the weather the zones go on by yesterday's shape."""

        try:
            await persevere("weather", source.name, take, failed, GrowingPause(FIRST_PAUSE, LONGEST_PAUSE))
        finally:
            await source.close()
