"""The configuration as a daemon keeps it beside its state, which is also what `show-config` prints."""

import shutil
import stat
from pathlib import Path

import pytest

from service.config.fitting import fingerprint, surroundings
from service.config.kept import keep_configuration, kept_configuration
from service.config.load import load
from service.config.written import effective_toml
from service.errors import ServiceError
from service.store.store import CONFIGURATION

CASES = Path(__file__).parent / "cases"

AUTO = 'zones.living.network="auto"'
SUN = 'zones.living.channels.I_sol={source = "log", column = "Sun", unit = "W/m2"}'
PLACE = ["site.latitude=47.67", "site.longitude=9.17", 'site.time_zone="Europe/Berlin"']
WAYS = {
    "as it is": [],
    "automatic": [AUTO],
    "the sun by the hour": [AUTO, SUN, "zones.living.floor_area=120"],
    "a building": ['site.construction="heavy"', AUTO, "zones.living.built=1965", 'zones.living.use="office"'],
    "the sun by facades": [AUTO, SUN, *PLACE, "zones.living.floor_area=120"],
    "a clear sky": [AUTO, *PLACE, 'zones.living.sun="clear-sky"'],
    "a bank": [AUTO, 'zones.living.estimator="bank"', "zones.living.estimator_options={discount = 0.99}"],
    "a preset with changes": [
        'zones.living.network={preset = "titeth", fixed = ["C_h"], parameters = {C_e = {value = 3e7}}, box = "wide"}'
    ],
    "a network of one's own": [
        'zones.living.network={name = "attic", measured = ["T_i"], boundaries = ["T_out"], '
        'capacitances = {T_i = {lower = 1e5, upper = 1e7}, T_w = {name = "C_wall", value = 4e6}}, '
        'conductances = [{name = "g_iw", between = ["T_i", "T_w"], lower = 10, upper = 500, nominal = 60}, '
        '{name = "g_wo", between = ["T_w", "T_out"], lower = 5, upper = 500, typical = 50}], '
        'heat_inputs = [{channel = "u_heat", node = "T_i", gain = {name = "f_i", lower = 0.02, upper = 0.98}}, '
        '{channel = "u_heat", node = "T_w", gain = {rest_of = "f_i"}}, '
        '{channel = "I_sol", node = "T_i", unit = "W/m2", gain = {name = "A_w", value = 4.5}}, '
        '{channel = "people", node = "T_i", unit = "people", gain = 80}], '
        'initial = {T_w = {source = "T_out", sd = 4.0}}}',
        SUN,
        'zones.living.channels.people={source = "log", column = "Sun", unit = "people"}',
    ],
    "options of an estimator": [
        'zones.living.estimator="rbpf"',
        'zones.living.estimator_options={preset = "paper", particles = 500}',
    ],
    "a socket": ['http={socket = "http.sock"}'],
    "a set-point": ['zones.living.setpoint={source = "log", column = "Bedroom", unit = "K", max_age = "1d"}'],
    "a forecast": [
        'weather.outlook={kind = "open-meteo", file = "forecast.json"}',
        'zones.living.channels.T_out.forecast={source = "outlook", series = "t", unit = "degF"}',
    ],
    "a fleet": ['fleet={database = "postgresql://db.example/x", password_file = "secret", shards = 3}'],
    "several servers of a fleet": ['fleet={database = "postgresql://me@a:5432,b:5433/x?target_session_attrs=any"}'],
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
        assert fingerprint(one) == fingerprint(other)
        assert (one.channels, one.setpoint) == (other.channels, other.setpoint)
        ours, theirs = one.network, other.network
        assert (ours.terms, ours.heat_inputs) == (theirs.terms, theirs.heat_inputs)
        assert {p.name: p for p in ours.free} == {p.name: p for p in theirs.free}
        assert surroundings(again, one) == surroundings(config, other)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert [file.name for file in config.site.state_dir.iterdir()] == [CONFIGURATION]


def test_a_folder_without_one_is_said(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match=r"there is no configuration\.toml in .*--config"):
        kept_configuration(tmp_path)
