"""The inputs of the steps to come, where no plan says: by a forecast of the weather, by yesterday's shape, or held."""

import numpy as np

from adapters.reading import Quality
from estimator.arrays import Array
from estimator.foresight import foreseen
from service.records.outlook import InputOrigin, Outlook, Weather, WeatherBook, WeatherLink
from service.records.update import InputUsed
from service.zone.worker import Standing, ZoneWorker

NO_WEATHER = Weather()


def foresee(worker: ZoneWorker, standing: Standing, steps: int, weather: Weather = NO_WEATHER) -> Outlook:
    """The inputs of `steps` intervals from the valid time of the `standing` forecast on, where no plan says."""
    forecast, period = standing.update.forecast, worker.period
    times = forecast.valid_time + period * np.arange(steps, dtype=np.float64)
    now = np.array([used.value for used in forecast.inputs])
    rows, by_shape = foreseen(worker.network, standing.carried.day, now, times)
    origins = []
    for column, used in enumerate(forecast.inputs):
        origin = _otherwise(used, bool(by_shape[column]))
        link = weather.links.get(used.channel)
        if link is not None and steps:
            origin = _by_weather(link, weather.book, forecast.issue_time, times, period, rows[:, column], origin)
        origins.append(origin)
    return Outlook(rows, tuple(origins))


def _by_weather(
    link: WeatherLink, book: WeatherBook, now: int, times: Array, period: int, values: Array, otherwise: InputOrigin
) -> InputOrigin:
    """Write into `values` (h,) what the newest forecast says, as far as it reaches; where they then come from."""
    forecast = book.newest(link.source)
    series = None if forecast is None else forecast.series.get(link.series)
    if forecast is None or series is None or series.unit not in ("", link.unit):
        return otherwise
    if now - forecast.issued > link.max_age:
        return otherwise
    told = series.interval_means(times, period) * link.conversion.scale + link.conversion.offset
    known = ~np.isnan(told)
    if not known.any():
        return otherwise
    values[known] = told[known]
    quality = Quality.GOOD if known.all() else Quality.UNCERTAIN
    return InputOrigin(otherwise.channel, "weather", link.source, max(0.0, now - forecast.issued), quality)


def _otherwise(used: InputUsed, by_shape: bool) -> InputOrigin:
    origin = "yesterday" if by_shape else "held"
    quality = Quality.UNCERTAIN if used.held and used.quality is Quality.GOOD else used.quality
    return InputOrigin(used.channel, origin, "", used.age, quality)
