"""The configuration as a daemon keeps it beside its state, which is also what `show-config` prints."""

from __future__ import annotations

import shutil
import stat
from pathlib import Path

import pytest

from service.config.fitting import fingerprint, surroundings
from service.config.kept import FILE, keep_configuration, kept_configuration
from service.config.load import load
from service.config.written import effective_toml
from service.errors import ServiceError

CASES = Path(__file__).parent / "cases"

AUTO = 'zones.living.network="auto"'
SUN = 'zones.living.channels.I_sol={source = "log", column = "Sun", unit = "W/m2"}'
PLACE = ["site.latitude=47.67", "site.longitude=9.17", 'site.time_zone="Europe/Berlin"']
WAYS = {
    "as it is": [],
    "automatic": [AUTO],
    "the sun by the hour": [AUTO, SUN, "zones.living.floor_area=120"],
    "the sun by facades": [AUTO, SUN, *PLACE, "zones.living.floor_area=120"],
    "a clear sky": [AUTO, *PLACE, 'zones.living.sun="clear-sky"'],
    "a bank": [AUTO, 'zones.living.estimator="bank"', "zones.living.estimator_options={discount = 0.99}"],
    "a socket": ['http={socket = "http.sock"}'],
    "a set-point": ['zones.living.setpoint={source = "log", column = "Bedroom", unit = "K", max_age = "1d"}'],
    "a forecast": [
        'weather.outlook={kind = "open-meteo", file = "forecast.json"}',
        'zones.living.channels.T_out.forecast={source = "outlook", series = "t", unit = "degF"}',
    ],
    "a fleet": ['fleet={database = "postgresql://db.example/x", password_file = "secret", shards = 3}'],
}


@pytest.mark.parametrize("changes", WAYS.values(), ids=WAYS)
def test_what_is_kept_loads_as_the_same_configuration(tmp_path: Path, changes: list[str]) -> None:
    for name in ("house.toml", "log.csv"):
        shutil.copy(CASES / name, tmp_path)
    config = load(tmp_path / "house.toml", changes)
    config.site.state_dir.mkdir(parents=True)
    for _ in range(2):
        keep_configuration(config)
    path = kept_configuration(config.site.state_dir)
    again = load(path)
    assert effective_toml(again) == effective_toml(config)
    assert (again.http, again.fleet, again.weather) == (config.http, config.fleet, config.weather)
    for one, other in zip(again.zones, config.zones, strict=True):
        assert (fingerprint(one), one.network.terms, one.setpoint) == (
            fingerprint(other),
            other.network.terms,
            other.setpoint,
        )
        assert list(one.options.members) == list(other.options.members)
        assert surroundings(again, one) == surroundings(config, other)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert [file.name for file in config.site.state_dir.iterdir()] == [FILE]


def test_a_folder_without_one_is_said(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match=r"there is no configuration\.toml in .*--config"):
        kept_configuration(tmp_path)
