"""Forecasts of the weather at work: a source that fails is tried again, and says once that it works again."""

import logging
from types import SimpleNamespace
from typing import Any

import numpy as np
from support.waiting import until

from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.weather.forecast import WeatherForecast, WeatherSeries
from service.daemon.supply import weather as module
from service.daemon.supply.weather import WeatherFeeds
from service.records.outlook import WeatherBook


class Failing:
    """A source that fails twice, then delivers two forecasts, and fails again for good."""

    name = "office"

    def __init__(self, error=SourceUnavailable):
        self.calls, self.closed, self.error = 0, False, error

    async def forecasts(self):
        self.calls += 1
        if self.calls != 3:
            raise self.error("weather.office: nobody answers")
        for issued in (0.0, 3600.0):
            yield WeatherForecast(issued, {"T_out": WeatherSeries(np.array([issued]), np.array([5.0]))})
        raise self.error("weather.office: nobody answers")

    async def close(self):
        self.closed = True


def configured(source: Failing) -> Any:
    return SimpleNamespace(weather={"office": 1}, weather_series=lambda name: (), build_weather=lambda name: source)


async def test_a_source_that_works_again_says_so_once(monkeypatch, caplog):
    monkeypatch.setattr(module, "FIRST_PAUSE", 0.001)
    monkeypatch.setattr(module, "LONGEST_PAUSE", 0.001)
    source = Failing()
    with caplog.at_level(logging.INFO):
        feeds = WeatherFeeds(WeatherBook())
        await feeds.follow(configured(source))
        await until(lambda: source.calls > 4)
        await feeds.stop()
    assert source.closed
    assert caplog.text.count("weather 'office' works again") == 1
    assert "weather.office: nobody answers; trying again in" in caplog.text


async def test_a_reload_tries_again_what_has_given_up():
    source, feeds = Failing(SourceConfigError), WeatherFeeds(WeatherBook())
    for calls in (1, 2):
        await feeds.follow(configured(source))
        await until(feeds._tasks["office"].done)
        assert source.calls == calls
    await feeds.stop()
