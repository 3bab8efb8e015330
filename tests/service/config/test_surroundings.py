"""What a configuration says of a zone's inputs: limits, neighbours, and forecasts of the weather."""

import json
from pathlib import Path
from typing import Any

import pytest
from support.config_samples import sound, write
from support.running_zone import plumbing
from support.waiting import until

from service.cli.show import summary
from service.config.fitting import surroundings
from service.config.load import load
from service.config.site import Config
from service.daemon.reload import compare, obstacles
from service.daemon.reload import summary as changes_of
from service.daemon.runtime import Runtime
from service.daemon.zone_table import Zones
from service.records.outlook import WeatherLink

NOON = "2026-01-31T12:00Z"


def tables(folder: Path) -> dict[str, Any]:
    """The sound configuration, with a forecast of the living room's outdoor temperature in another unit."""
    found = sound(folder)
    found["weather"] = {"outlook": {"kind": "open-meteo", "file": "forecast.json"}}
    told = {"source": "outlook", "series": "temperature_2m", "unit": "degF"}
    found["zones"][0]["channels"]["T_out"]["forecast"] = told
    found["zones"][0]["channels"]["u_heat"]["installed"] = 2500.0
    return found


def loaded(folder: Path, given: dict[str, Any]) -> Config:
    return load(write(folder, given))


def test_limits_are_those_of_valid_installed_and_nominal(tmp_path: Path) -> None:
    given = tables(tmp_path)
    given["zones"][0]["channels"]["T_out"]["valid"] = [-20.0, 40.0]
    given["zones"][1]["channels"]["u_heat"] |= {"unit": "%", "nominal": 1800.0}
    living, bedroom = surroundings(loaded(tmp_path, given)).values()
    assert living.limits == {"T_i": (-60.0, 80.0), "T_out": (-20.0, 40.0), "u_heat": (-2500.0, 2500.0)}
    assert bedroom.limits["u_heat"] == (-1800.0, 1800.0)
    assert (living.entered, bedroom.entered) == (False, True)
    assert bedroom.limits["I_sol"] == (-20.0, 2000.0)


def test_a_forecast_of_the_weather_is_linked_with_its_unit(tmp_path: Path) -> None:
    config = loaded(tmp_path, tables(tmp_path))
    (link,) = surroundings(config)["living"].weather.values()
    assert isinstance(link, WeatherLink)
    assert (link.source, link.series, link.unit, link.max_age) == ("outlook", "temperature_2m", "degF", 86400.0)
    assert 212.0 * link.conversion.scale + link.conversion.offset == pytest.approx(100.0)
    assert "weather outlook: open-meteo, forecast.json" in summary(config)


def test_a_neighbour_is_whoever_is_measured_there(tmp_path: Path) -> None:
    given = sound(tmp_path)
    for zone, other in ((0, "Bedroom"), (1, "Living")):
        given["zones"][zone] |= {"network": "auto"}
        given["zones"][zone]["channels"] |= {"T_adj": {"source": "log", "column": other, "unit": "degC"}}
    living, bedroom = surroundings(loaded(tmp_path, given)).values()
    assert living.neighbours == {"T_adj": ("bedroom", "T_i")}
    assert bedroom.neighbours == {"T_adj": ("living", "T_i")}
    del given["zones"][1]["channels"]["T_adj"]
    assert surroundings(loaded(tmp_path, given))["living"].neighbours == {"T_adj": ("bedroom", "T_i")}


async def test_a_reload_follows_the_weather(tmp_path: Path) -> None:
    """A daemon's zones use the forecast of the table that is in force."""
    for name, value in (("forecast", 50.0), ("other", 68.0)):
        hourly = {"time": [NOON, "2026-02-28T12:00Z"], "temperature_2m": [value, value]}
        units = {"temperature_2m": "°F"}
        (tmp_path / f"{name}.json").write_text(json.dumps({"hourly": hourly, "hourly_units": units}), encoding="utf-8")
    given = tables(tmp_path)
    for zone in given["zones"]:
        zone["estimator"] = "ekf"
    config = loaded(tmp_path, given)
    given["weather"]["outlook"]["file"] = "other.json"
    new = loaded(tmp_path, given)
    assert compare(config, new).weather
    assert changes_of(compare(config, new)) == "weather changed"
    assert obstacles(config, new, {}) == []

    def tells(book: Any, expected: float) -> bool:
        found = book.newest("outlook")
        return found is not None and found.series["temperature_2m"].values[0] == expected

    async with plumbing(tmp_path / "state") as shared:
        runtime = Runtime(config, Zones(), shared)
        await runtime.restore()
        runtime.start_zones()
        await runtime.start_feeds()
        await until(lambda: tells(shared.weather, 50.0))
        assert runtime.zones["living"].surroundings.limits["u_heat"] == (-2500.0, 2500.0)
        await runtime.reload(new)
        await until(lambda: tells(shared.weather, 68.0))
        del given["weather"], given["zones"][0]["channels"]["T_out"]["forecast"]
        await runtime.reload(loaded(tmp_path, given))
        assert shared.weather.newest("outlook") is None
        assert runtime.zones["living"].surroundings.weather == {}
        await runtime.stop_feeds()
        await runtime.drain()
