"""What a sound configuration becomes: defaults, durations, absolute paths, sources."""

import math
from pathlib import Path

import pytest
from support.config_samples import sound, write
from support.tables import tabled

from adapters.fields.durations import format_duration, parse_duration
from service.config.fitting import fingerprint
from service.config.load import load


def test_relative_paths_are_taken_from_the_folder_of_the_file_and_home_is_expanded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    write(tmp_path, sound(tmp_path))
    monkeypatch.chdir(elsewhere)
    config = load(Path("../house.toml"))
    assert config.sources["log"].files == (tmp_path / "log.csv",)
    assert config.site.state_dir == tmp_path / "var/thermogate"
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert load(Path("../house.toml"), ["site.state_dir=~/state"]).site.state_dir == tmp_path / "home/state"


def test_windows_line_ends_and_byte_order_mark(tmp_path: Path) -> None:
    path = write(tmp_path, sound(tmp_path))
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert [zone.id for zone in load(path).zones] == ["living", "bedroom"]


@tabled
def test_durations_are_written_in_the_largest_unit_that_fits(written: object, seconds: float, shown: str) -> None:
    assert parse_duration(written) == seconds
    assert (format_duration(seconds), parse_duration(shown)) == (shown, seconds)


@pytest.mark.parametrize("wrong", ["", "5", "5m", "min", "1h30min", "-1s", "1e999s", -1, math.nan, None, True, []])
def test_what_is_no_duration(wrong: object) -> None:
    with pytest.raises(ValueError, match="is not a duration; write a number with s, min, h or d"):
        parse_duration(wrong)


def test_a_set_point_is_delivered_beside_the_channels(tmp_path: Path) -> None:
    tables = sound(tmp_path)
    without = load(write(tmp_path, tables))
    tables["zones"][0]["setpoint"] = {"source": "log", "column": "Bedroom", "unit": "K", "max_age": "1d"}
    tables["zones"][0]["channels"]["u_heat"]["valid"] = [0, 500]
    config = load(write(tmp_path, tables))
    zone = config.zones[0]
    assert (zone.setpoint.aggregate, zone.setpoint.valid) == ("mean", (-60.0, 80.0))
    (binding,) = [binding for binding in config.bindings("log") if binding.id == "living/setpoint"]
    assert (binding.unit, binding.usual) == ("degC", (5.0, 40.0))
    (told,) = [binding.usual for binding in config.bindings("log") if binding.id == "living/u_heat"]
    assert told == (-math.inf, math.inf), "whoever gives `valid` has said what is usual"
    assert fingerprint(zone) == fingerprint(without.zones[0]), "what was learned goes on"
    assert "living/setpoint" not in [binding.id for binding in without.bindings("log")]
