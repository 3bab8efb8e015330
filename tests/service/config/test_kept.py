"""The configuration as a daemon keeps it beside its state, which is also what `show-config` prints."""

import shutil
import stat
from pathlib import Path

import pytest
from support.tables import tabled

from service.config.fitting import fingerprint, surroundings
from service.config.kept import keep_configuration, kept_configuration
from service.config.load import load
from service.config.written import effective_toml
from service.errors import ServiceError
from service.store.store import CONFIGURATION

CASES = Path(__file__).parent / "cases"


@tabled
def test_what_is_kept_loads_as_the_same_configuration(tmp_path: Path, way: str, changes: list[str]) -> None:
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
    assert surroundings(again) == surroundings(config)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600, way
    assert [file.name for file in config.site.state_dir.iterdir()] == [CONFIGURATION]


def test_a_folder_without_one_is_said(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match=r"there is no configuration\.toml in .*--config"):
        kept_configuration(tmp_path)
