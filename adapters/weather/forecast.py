"""A forecast of the weather, and what every source of them offers."""

from collections.abc import AsyncIterator, Mapping
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

MEANS = ("instant", "preceding", "following")
"""What a value is about: its instant, the time since the value before, or until the next."""


class WeatherSeries(NamedTuple):
    """A series: `values` (n,) in `unit` ("": not said) at `times` (n,), UTC s, increasing; `means` is one of MEANS."""

    times: Array
    values: Array
    unit: str = ""
    means: str = "instant"

    def interval_means(self, times: Array, period: float) -> Array:
        """The mean (h,) over the intervals of `period` s from `times` (h,); NaN where nothing is known. Between
        instants a line's value in the middle of an interval stands for it."""
        if len(self.times) < 2:
            return np.full(len(times), np.nan)
        middle, last = times + period / 2.0, self.times[-1]
        if self.means == "instant":
            return np.interp(middle, self.times, self.values, left=np.nan, right=np.nan)
        if self.means == "preceding":
            place = np.minimum(np.searchsorted(self.times, middle, side="left"), len(self.times) - 1)
            return np.where((middle > self.times[0]) & (middle <= last), self.values[place], np.nan)
        end = last + (last - self.times[-2])
        place = np.maximum(np.searchsorted(self.times, middle, side="right") - 1, 0)
        return np.where((middle >= self.times[0]) & (middle < end), self.values[place], np.nan)


class WeatherForecast(NamedTuple):
    """A forecast that was issued, or else came to be known, at UTC s `issued`: series by name."""

    issued: float
    series: Mapping[str, WeatherSeries]


class WeatherSource(Protocol):
    name: str

    def check(self) -> list[str]:
        """What is wrong with it, one sentence each, as far as that can be told without connecting to anything."""
        return []

    def forecasts(self) -> AsyncIterator[WeatherForecast]:
        """Every new forecast, for ever. Raises SourceUnavailable, after which it may be called again."""
        ...

    async def close(self) -> None:
        """Let go of everything, if anything is held; safe to call twice."""
        return


def series_of(times: Array, values: Array, unit: str, means: str) -> WeatherSeries:
    """The known values of a column, in the order of time, each time once."""
    known = np.isfinite(times) & np.isfinite(values)
    order, first = np.unique(times[known], return_index=True)
    return WeatherSeries(order, values[known][first], unit, means)
