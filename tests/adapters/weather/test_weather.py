"""Forecasts of the weather from files, an address and Zenoh: read, read anew, and refused in one sentence."""

import asyncio
import json
import os
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import aclosing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.processes import free_port
from support.tables import tabled
from support.waiting import repeated
from support.web_answers import answering
from support.zenoh_plant import endpoint
from support.zenoh_plant import session as session_of

from adapters.csv.config import LayoutConfig
from adapters.errors import SourceUnavailable
from adapters.weather.document import LONGEST, parse
from adapters.weather.forecast import WeatherForecast, WeatherSeries
from adapters.weather.heard import HeardForecasts
from adapters.weather.polled import csv_file, json_address, json_file
from adapters.zenoh.connection import SessionConfig

NOON = 1_769_860_800.0  # 2026-01-31T12:00:00Z
DOCUMENT: dict[str, Any] = json.loads(Path(__file__).with_name("open-meteo.json").read_text(encoding="utf-8"))


def written(**changes: Any) -> bytes:
    return json.dumps(DOCUMENT | changes).encode()


def test_the_json_of_open_meteo_is_read_with_units_times_and_meanings() -> None:
    forecast = parse(written(), NOON)
    assert forecast.issued == NOON
    temperature, sun = forecast.series["temperature_2m"], forecast.series["shortwave_radiation"]
    assert (temperature.unit, temperature.means) == ("degC", "instant")
    # What is null is no value, and 13:00 an hour ahead of UTC is noon.
    assert (temperature.times - NOON).tolist() == [0.0, 7200.0]
    assert (sun.unit, sun.means, sun.values.tolist()) == ("W/m2", "preceding", [0.0, 100.0, 200.0])


def test_finer_series_count_and_a_document_may_say_when_it_was_issued() -> None:
    finer = {"time": [NOON, NOON + 900], "temperature_2m": [1, 2], "shortwave_radiation_instant": [5, 6]}
    forecast = parse(written(minutely_15=finer, issued="2026-01-31T06:00:00Z"), NOON)
    assert forecast.issued == NOON - 6 * 3600
    assert forecast.series["temperature_2m"].values.tolist() == [1.0, 2.0]
    # As is usual in JavaScript, in milliseconds: it would be young for 50,000 years.
    assert parse(written(issued=1000 * NOON), NOON).issued == NOON
    assert forecast.series["shortwave_radiation_instant"].means == "instant"
    assert "shortwave_radiation" in forecast.series


def assert_refused(content: bytes, words: str) -> None:
    with pytest.raises(SourceUnavailable, match=words) as refused:
        parse(content, NOON)
    assert "\n" not in str(refused.value)


@tabled
def test_a_document_that_is_none_is_refused_in_one_sentence(content: str | dict[str, Any], words: str) -> None:
    assert_refused(content.encode() if isinstance(content, str) else written(**content), words)


def test_a_document_beyond_all_measure_is_refused_in_one_sentence() -> None:
    for content, words in (
        (b"[" * 100_000, "this is not JSON"),
        (b" " * (LONGEST + 1), "longer than 4000000 bytes; ask for fewer series"),
        (written(hourly={"time": [NOON], "t": [10**400]}), "hourly.t holds a number too large"),
        (written(hourly={"time": ["x" * 10**6], "t": [1.0]}), r"xxx\.\.\. is no time"),
        (written(utc_offset_seconds=10**400), "utc_offset_seconds is 1000"),
    ):
        assert_refused(content, words)


def test_a_series_is_averaged_over_intervals_as_its_values_mean() -> None:
    times, values = NOON + 3600.0 * np.arange(3), np.array([0.0, 10.0, 30.0])
    starts = NOON + 1800.0 * np.arange(-1, 5)
    for name, expected in {
        "instant": [np.nan, 2.5, 7.5, 15.0, 25.0, np.nan],
        "preceding": [np.nan, 10.0, 10.0, 30.0, 30.0, np.nan],
        "following": [np.nan, 0.0, 0.0, 10.0, 10.0, 30.0],
    }.items():
        found = WeatherSeries(times, values, "", name).interval_means(starts, 1800.0)
        assert np.array_equal(found, expected, equal_nan=True), name
    assert np.isnan(WeatherSeries(times[:1], values[:1]).interval_means(starts, 1800.0)).all()


def first(source: Any, then: Callable[[AsyncIterator[WeatherForecast]], Awaitable[Any]] | None = None) -> Any:
    """The first forecast of `source`, or what `then` makes of them all."""

    async def asked() -> Any:
        async with asyncio.timeout(120), aclosing(source.forecasts()) as forecasts:
            try:
                return await (anext(forecasts) if then is None else then(forecasts))
            finally:
                await source.close()

    return asyncio.run(asked())


LAYOUT = LayoutConfig(timestamp={"column": "time"}, delimiter=";", decimal=",")


def test_of_a_file_that_is_too_long_no_more_is_read_than_may_be(tmp_path: Path) -> None:
    path = tmp_path / "weather.json"
    path.touch()
    # Holes take no room on the disk; read whole, they would take more memory than there is.
    os.truncate(path, 2**40)
    with pytest.raises(SourceUnavailable, match=r"weather\.forecast: the document is longer than 4000000 bytes"):
        first(json_file("forecast", path, 1.0))


def test_a_csv_file_is_read_anew_when_it_is_written_anew(tmp_path: Path) -> None:
    path = tmp_path / "forecast.csv"
    path.write_text("time;T;wind\n2026-01-31T13:00Z;2,5;1\n2026-01-31T12:00Z;1,5;1\n2026-01-31T14:00Z;;1\n")
    os.utime(path, (NOON, NOON))

    async def twice(forecasts: AsyncIterator[WeatherForecast]) -> list[WeatherForecast]:
        before = await anext(forecasts)
        path.write_text("time;T\n2026-01-31T12:00Z;9\n")
        return [before, await anext(forecasts)]

    source = csv_file("outlook", path, 0.01, LAYOUT, "following", ["T"])
    assert source.check() == []
    one, two = first(source, twice)
    assert one.issued == NOON
    assert (one.series["T"].times - NOON).tolist() == [0.0, 3600.0]
    assert one.series["T"].values.tolist() == [1.5, 2.5]
    assert one.series["T"].means == "following"
    assert two.series["T"].values.tolist() == [9.0]


def test_a_csv_file_says_what_is_wrong_with_it(tmp_path: Path) -> None:
    path = tmp_path / "forecast.csv"
    source = csv_file("outlook", path, 60, LAYOUT, "instant", ["T"])
    assert source.check() == [], "it may come later"
    with pytest.raises(SourceUnavailable, match=r"weather.outlook: .* cannot be read \(no such file"):
        first(source)
    path.write_text("time;temperature\n")
    (problem,) = csv_file("outlook", path, 60, LAYOUT, "instant", ["T"]).check()
    assert problem.startswith("weather.outlook: file ")
    assert "has no column 'T'" in problem


def test_an_address_is_asked_again_and_again_and_named_where_it_refuses_or_is_not_there() -> None:
    answers = [(200, written()), (200, written(issued=NOON)), (429, b"later")]

    async def twice(forecasts: AsyncIterator[WeatherForecast]) -> list[WeatherForecast]:
        return [await anext(forecasts), await anext(forecasts)]

    with answering(lambda *_: answers.pop(0)) as url:
        one, two = first(json_address("outlook", f"{url}/v1/forecast", 0.01), twice)
        assert one.series["temperature_2m"].values.tolist() == [3.0, 5.0]
        assert two.issued == NOON
        with pytest.raises(SourceUnavailable, match=r"weather.outlook: the address answers 429 Too Many Requests"):
            first(json_address("outlook", url, 60))
    with pytest.raises(SourceUnavailable, match=r"weather.outlook: the address cannot be reached"):
        first(json_address("outlook", f"http://127.0.0.1:{free_port()}/", 60))


@contextmanager
def station(document: bytes | None) -> Iterator[HeardForecasts]:
    """A source that hears a publisher of `document` on its key; without one, the publisher deletes the key."""
    place = endpoint()
    with session_of(listen=place) as session:

        def publish() -> None:
            if document is None:
                session.delete("site/weather")
            else:
                session.put("site/weather", document)

        with repeated(publish, 0.05):
            yield HeardForecasts("outlook", SessionConfig(mode="client", connect=[place]), "site/weather")


def test_documents_are_heard_on_zenoh() -> None:
    with station(written(issued=NOON)) as source:
        assert source.check() == []
        assert first(source).issued == NOON


@pytest.mark.parametrize(
    ("document", "said"),
    [(b" " * 65_537, "has 65537 bytes; at most 65536 are read"), (None, "was deleted")],
    ids=["long", "deleted"],
)
def test_a_document_on_zenoh_that_is_too_long_or_deleted_is_told(document: bytes | None, said: str) -> None:
    with (
        station(document) as source,
        pytest.raises(SourceUnavailable, match=rf"^weather.outlook: the document on site/weather {said}$"),
    ):
        first(source)
