"""What a sound configuration becomes: defaults, durations, absolute paths, sources."""

from __future__ import annotations

import asyncio
import math
import zlib
from pathlib import Path
from typing import Any

import pytest
from support.config_samples import inline_network, sound, write

from adapters.fields.durations import format_duration, parse_duration
from adapters.reading import Fault, Reading
from service.cli.show import summary
from service.config.fitting import fingerprint
from service.config.load import load
from service.errors import ConfigError


def test_defaults(tmp_path: Path) -> None:
    config = load(write(tmp_path, sound(tmp_path)))

    assert config.site.state_dir == tmp_path / "var/thermogate"
    assert config.site.checkpoint_every == 300
    assert (config.site.keep_history, config.site.max_journal) == (400 * 86400, 2 * 10**9)
    assert (config.http.host, config.http.port) == ("127.0.0.1", 8080)
    zenoh = config.sinks["zenoh"]
    assert zenoh.enabled
    assert (zenoh.mode, zenoh.listen, zenoh.connect) == (
        "peer",
        ("tcp/127.0.0.1:7447",),
        (),
    )
    assert zenoh.await_subscriber == 0
    log = config.sources["log"]
    assert (log.delimiter, log.decimal, log.encoding, log.pace) == (",", ".", "utf-8", math.inf)
    living = config.zones[0]
    assert (living.period, living.estimator, living.levels) == (300, "bank", (0.95,))
    assert (living.max_gap, living.hold_inputs, living.lateness) == (12, 900, 0)
    assert living.estimator_options == {}


def test_what_is_given_replaces_the_defaults(tmp_path: Path) -> None:
    tables = sound(tmp_path)
    tables["site"] |= {
        "state_dir": "/srv/state",
        "checkpoint_every": "1h",
        "keep_history": "90d",
        "max_journal": "500MB",
    }
    tables["http"] = {"host": "::1", "port": 0}
    tables["zenoh"] = {
        "mode": "client",
        "listen": [],
        "connect": ["tcp/192.168.1.5:7447"],
        "enabled": False,
        "await_subscriber": "2s",
    }
    tables["sources"]["log"]["pace"] = 60
    tables["zones"][0] |= {"seed": 7, "levels": [0.5, 0.9], "max_gap": 0, "hold_inputs": 0, "lateness": "1min"}

    config = load(write(tmp_path, tables))

    assert (config.site.state_dir, config.site.checkpoint_every) == (Path("/srv/state"), 3600)
    assert (config.site.keep_history, config.site.max_journal) == (90 * 86400, 5 * 10**8)
    assert (config.http.host, config.http.port) == ("::1", 0)
    assert config.sinks["zenoh"].model_dump(exclude_defaults=True) == tables["zenoh"] | {
        "listen": (),
        "connect": ("tcp/192.168.1.5:7447",),
        "await_subscriber": "2s",
    }
    assert config.sources["log"].pace == 60
    living = config.zones[0]
    assert (living.seed, living.levels, living.max_gap) == (7, (0.5, 0.9), 0)
    assert (living.hold_inputs, living.lateness) == (0, 60)


def test_default_seed_follows_from_site_and_zone(tmp_path: Path) -> None:
    living, bedroom = load(write(tmp_path, sound(tmp_path))).zones

    assert living.seed == zlib.crc32(b"house/living")
    assert bedroom.seed == zlib.crc32(b"house/bedroom")


def test_default_aggregates_follow_from_the_unit(tmp_path: Path) -> None:
    bedroom = load(write(tmp_path, sound(tmp_path))).zones[1]

    assert {name: channel.aggregate for name, channel in bedroom.channels.items()} == {
        "T_i": "mean",
        "T_out": "mean",
        "u_heat": "first",
        "I_sol": "mean",
    }


def test_valid_range_defaults_to_what_is_physical_and_is_wide_for_own_units(tmp_path: Path) -> None:
    tables = sound(tmp_path)
    tables["zones"][0]["network"] = inline_network()
    tables["zones"][0]["channels"] = {
        "T_air": {"source": "log", "column": "Living", "unit": "degC", "valid": [-10, 45]},
        "T_out": {"source": "log", "column": "Outside", "unit": "degC"},
        "u_heat": {"source": "log", "column": "Power1", "unit": "kW"},
        "I_sol": {"source": "log", "column": "Sun", "unit": "W/m2"},
        "n_people": {"source": "log", "column": "Sun", "unit": "people"},
    }

    channels = load(write(tmp_path, tables)).zones[0].channels

    assert channels["T_air"].valid == (-10, 45)
    assert channels["T_out"].valid == (-60, 80)
    assert channels["u_heat"].valid == (-1e6, 1e6)
    assert channels["n_people"].valid == (-1e9, 1e9)


def test_relative_paths_are_taken_from_the_folder_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    write(tmp_path, sound(tmp_path))
    monkeypatch.chdir(elsewhere)

    config = load(Path("../house.toml"))

    assert config.sources["log"].files == (tmp_path / "log.csv",)
    assert config.site.state_dir == tmp_path / "var/thermogate"


def test_home_folder_is_expanded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))

    config = load(write(tmp_path, sound(tmp_path)), ["site.state_dir=~/state"])

    assert config.site.state_dir == tmp_path / "home/state"


def test_home_of_an_unknown_user(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"site\.state_dir: .* unknown user"):
        load(write(tmp_path, sound(tmp_path)), ["site.state_dir=~no-such-user-here/state"])


def test_windows_line_ends_and_byte_order_mark(tmp_path: Path) -> None:
    path = write(tmp_path, sound(tmp_path))
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))

    assert [zone.id for zone in load(path).zones] == ["living", "bedroom"]


@pytest.mark.parametrize(
    ("written", "seconds"),
    [
        ("30s", 30),
        ("5min", 300),
        ("1h", 3600),
        ("7d", 604800),
        ("1.5 h", 5400),
        (90, 90),
        (0.5, 0.5),
        ("0s", 0),
        (0, 0),
    ],
)
def test_durations(written: object, seconds: float) -> None:
    assert parse_duration(written) == seconds


@pytest.mark.parametrize(
    "wrong", ["", "5", "5m", "min", "1h30min", "-1s", "1e999s", -1, math.nan, math.inf, None, True, []]
)
def test_what_is_no_duration(wrong: object) -> None:
    with pytest.raises(ValueError, match="is not a duration; write a number with s, min, h or d"):
        parse_duration(wrong)


@pytest.mark.parametrize("seconds", [0, 0.1, 1, 59, 60, 90, 3600, 5400, 86400, 604800, 1e-7, 1 / 3])
def test_durations_are_written_so_that_they_read_back(seconds: float) -> None:
    assert parse_duration(format_duration(seconds)) == seconds


@pytest.mark.parametrize(
    ("seconds", "written"), [(0, "0s"), (30, "30s"), (90, "90s"), (300, "5min"), (5400, "90min"), (86400, "1d")]
)
def test_durations_are_written_in_the_largest_fitting_unit(seconds: float, written: str) -> None:
    assert format_duration(seconds) == written


@pytest.mark.parametrize("period", ["1s", "5min", "10min", 450, "1h", 7200, "1d"])
def test_periods_that_divide_a_day(period: object, tmp_path: Path) -> None:
    tables = sound(tmp_path)
    tables["zones"][0]["period"] = period

    seconds = load(write(tmp_path, tables)).zones[0].period

    assert isinstance(seconds, int)
    assert 86400 % seconds == 0


@pytest.mark.parametrize("host", ["127.0.0.1", "127.9.9.9", "::1", "[::1]", "localhost"])
def test_loopback_hosts(host: str, tmp_path: Path) -> None:
    tables = sound(tmp_path) | {"http": {"host": host}}

    assert load(write(tmp_path, tables)).http.host == host.strip("[]")


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:0", "tcp/[::1]:7447", "udp/localhost:7447", "ws/127.0.0.2:8000"])
def test_loopback_endpoints(endpoint: str, tmp_path: Path) -> None:
    tables = sound(tmp_path) | {"zenoh": {"listen": [endpoint]}}

    assert load(write(tmp_path, tables)).sinks["zenoh"].listen == (endpoint,)


def readings(folder: Path, tables: dict[str, Any]) -> list[Reading]:
    source = load(write(folder, tables)).build_source("log")

    async def collect() -> list[Reading]:
        return [reading async for batch in source.batches(None) for reading in batch.readings]

    return asyncio.run(collect())


def test_source_delivers_every_channel_of_every_zone_in_the_units_of_the_network(tmp_path: Path) -> None:
    delivered = readings(tmp_path, sound(tmp_path))

    # 3 May 2025 00:00 in Berlin is 22:00 UTC on the day before.
    assert {reading.time for reading in delivered} == {1746223200.0}
    assert {reading.channel: reading.value for reading in delivered} == pytest.approx(
        {
            "living/T_i": 20.5,
            "living/T_out": 10.0,
            "living/u_heat": 600.0,
            "bedroom/T_i": 19.5,
            "bedroom/T_out": 10.0,
            "bedroom/u_heat": 400.0,
            "bedroom/I_sol": 0.0,
        }
    )


def test_source_applies_scale_offset_and_valid_range(tmp_path: Path) -> None:
    tables = sound(tmp_path)
    tables["zones"][0]["channels"]["T_i"] |= {"scale": 2.0, "offset": -1.0}
    tables["zones"][0]["channels"]["u_heat"]["valid"] = [0, 500]

    delivered = {reading.channel: reading for reading in readings(tmp_path, tables)}

    assert delivered["living/T_i"].value == 40.0
    assert delivered["living/u_heat"].fault is Fault.OUT_OF_RANGE


def test_a_set_point_is_delivered_beside_the_channels(tmp_path: Path) -> None:
    tables = sound(tmp_path)
    without = load(write(tmp_path, tables))
    tables["zones"][0]["setpoint"] = {"source": "log", "column": "Bedroom", "unit": "K", "max_age": "1d"}
    config = load(write(tmp_path, tables))
    zone = config.zones[0]
    assert zone.setpoint is not None
    assert (zone.setpoint.aggregate, zone.setpoint.valid) == ("mean", (-60.0, 80.0))
    (binding,) = [binding for binding in config.bindings("log") if binding.id == "living/setpoint"]
    assert (binding.unit, binding.usual) == ("degC", (5.0, 40.0))
    assert fingerprint(zone) == fingerprint(without.zones[0]), "what was learned goes on"
    assert "living/setpoint" not in [binding.id for binding in without.bindings("log")]
    assert "  setpoint [degC]: mean of Bedroom [K] from log" in summary(config)
