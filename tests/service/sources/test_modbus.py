"""Modbus in the configuration: what is taken over from the source, and every mistake in one sentence."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import pytest
from support.config_samples import sound, write
from support.config_spoiling import Change, at

from adapters.modbus.codec import Format
from adapters.modbus.config import ModbusChannelConfig
from service.config.load import load
from service.config.written import effective_toml
from service.errors import ConfigError

CHANNELS = "zones[0] ('living').channels"


def modbus(folder: Path) -> dict[str, Any]:
    """The sound configuration with its first zone on Modbus."""
    tables = sound(folder)
    tables["sources"]["bms"] = {"kind": "modbus", "host": "10.0.0.5", "first_register": 1, "type": "float32"}
    tables["zones"][0]["channels"] = {
        "T_i": {"source": "bms", "register": 101, "unit": "degC"},
        "T_out": {"source": "bms", "register": 7, "table": "input", "type": "int16", "scale": 0.1, "unit": "degC"},
        "u_heat": {"source": "bms", "register": 3, "table": "coil", "unit": "%", "scale": 100, "nominal": 1500},
    }
    return tables


def changed(*keys: str | int, **values: object) -> Change:
    return at(*keys, **values)


def air(**values: object) -> Change:
    return at("zones", 0, "channels", "T_i", **values)


def bms(**values: object) -> Change:
    return at("sources", "bms", **values)


def test_a_channel_takes_over_what_it_does_not_say(tmp_path: Path) -> None:
    tables = modbus(tmp_path)
    bms(unit_id=4, order="CDAB", not_available=[math.nan, 0x8000], stuck_after="1h")(tables)
    channels = load(write(tmp_path, tables)).zones[0].channels
    air, out, heat = (channels[name] for name in ("T_i", "T_out", "u_heat"))
    assert isinstance(air, ModbusChannelConfig)
    assert isinstance(out, ModbusChannelConfig)
    assert isinstance(heat, ModbusChannelConfig)
    assert (air.unit_id, air.table, air.stuck_after) == (4, "holding", 3600.0)
    assert air.format == Format("float32", "CDAB", None, air.format.not_available)
    assert (out.table, out.format.type) == ("input", "int16")
    assert (heat.table, heat.format.type) == ("coil", "bool"), "the type of a coil goes without saying"
    assert air.address == "unit 4 holding 101 float32 CDAB"


def test_what_a_channel_says_goes_before_its_source(tmp_path: Path) -> None:
    tables = modbus(tmp_path)
    bms(unit_id=4, order="CDAB", not_available=[1])(tables)
    air(unit_id=9, order="DCBA", type="float64", not_available=[])(tables)
    channel = load(write(tmp_path, tables)).zones[0].channels["T_i"]
    assert isinstance(channel, ModbusChannelConfig)
    assert (channel.unit_id, channel.format) == (9, Format("float64", "DCBA", None, ()))


def test_registers_are_counted_as_the_manual_counts(tmp_path: Path) -> None:
    config = load(write(tmp_path, modbus(tmp_path)))
    listed = {channel.id: channel for channel in config.build_source("bms")._listed}  # type: ignore[attr-defined]
    assert (listed["living/T_i"].address, listed["living/T_i"].register) == (100, 101)


def test_what_show_config_prints_is_accepted_and_the_same(tmp_path: Path) -> None:
    tables = modbus(tmp_path)
    bms(not_available=[math.nan, 0x8000], serial=None)(tables)
    first = load(write(tmp_path, tables))
    text = effective_toml(first)
    channel = tomllib.loads(text)["zones"][0]["channels"]["T_i"]
    assert (channel["register"], channel["type"], channel["order"], channel["unit_id"]) == (101, "float32", "ABCD", 1)
    (tmp_path / "again.toml").write_text(text, encoding="utf-8")
    assert effective_toml(load(tmp_path / "again.toml")) == text


MISTAKES: dict[str, tuple[Change, str, tuple[str, ...]]] = {
    "no register": (
        air(register=None),
        f"{CHANNELS}.T_i.register",
        ("is missing; give the number of its first register",),
    ),
    "a column": (air(column="T"), f"{CHANNELS}.T_i.column", ("is not a known key", "register", "order", "stuck_after")),
    "a misspelt key": (air(regster=3), f"{CHANNELS}.T_i.regster", ('did you mean "register"?',)),
    "no type anywhere": (
        bms(type=None),
        f"{CHANNELS}.T_i",
        ("type is missing; give it here or in sources.bms", "int16"),
    ),
    "text": (air(type="string"), f"{CHANNELS}.T_i.type", ('"string" is text, which cannot be measured', "float32")),
    "unknown type": (air(type="float"), f"{CHANNELS}.T_i.type", ('must be "int16"', 'not "float"')),
    "unknown order": (air(order="ACBD"), f"{CHANNELS}.T_i.order", ('must be "ABCD", "CDAB", "BADC" or "DCBA"',)),
    "unknown table": (air(table="holdings"), f"{CHANNELS}.T_i.table", ('"holding", "input", "coil" or "discrete"',)),
    "register 0 of a manual that begins with 1": (
        air(register=0),
        f"{CHANNELS}.T_i",
        ("register 0 is not there", "1 to 65535"),
    ),
    "a number past the last register": (air(register=65536), f"{CHANNELS}.T_i", ("can begin at 1 to 65535",)),
    "a number in a coil": (air(table="coil", type="int16"), f"{CHANNELS}.T_i", ("a coil is a single bit",)),
    "a bit of a number": (air(bit=3, type="int16"), f"{CHANNELS}.T_i", ("bit picks one bit of a register",)),
    "bit 16": (air(bit=16), f"{CHANNELS}.T_i.bit", ("must be a whole number from 0 to 15",)),
    "no first register": (bms(first_register=None), "sources.bms.first_register", ("is missing; give 0 or 1",)),
    "no host": (bms(host=None), "sources.bms", ('transport "tcp" needs host',)),
    "rtu with a host": (bms(transport="rtu"), "sources.bms", ('"rtu" is a serial port', "rtu-over-tcp")),
    "a serial port over tcp": (bms(serial={"device": "/dev/ttyS0"}), "sources.bms", ("and no serial",)),
    "unknown transport": (bms(transport="udp"), "sources.bms.transport", ('must be "tcp", "rtu-over-tcp" or "rtu"',)),
    "unknown parity": (
        bms(transport="rtu", host=None, serial={"device": "/dev/ttyS0", "parity": "E"}),
        "sources.bms.serial.parity",
        ('must be "even", "odd" or "none"',),
    ),
    "too many registers": (bms(max_registers=126), "sources.bms.max_registers", ("from 1 to 125",)),
    "no time to poll": (bms(poll=0), "sources.bms.poll", ("must be longer than 0",)),
    "patience": (bms(timeout="2min"), "sources.bms.timeout", ("must be at most 1min, not 2min",)),
    "no list of absent values": (bms(not_available=0x8000), "sources.bms.not_available", ("a list of numbers",)),
    "text among absent values": (bms(not_available=["nan"]), "sources.bms.not_available[0]", ("must be a number",)),
    "unknown key": (bms(hots="x"), "sources.bms.hots", ('did you mean "host"?',)),
    "live and recorded": (
        at("zones", 0, "channels", T_out={"source": "log", "column": "Outside", "unit": "degC"}),
        CHANNELS,
        ("mix live telemetry (bms) with recorded telemetry (log)",),
    ),
    "age of a measured temperature": (
        air(max_age="1h"),
        f"{CHANNELS}.T_i.max_age",
        ("a measured temperature never is",),
    ),
    "percent without nominal": (
        at("zones", 0, "channels", "u_heat", nominal=None),
        f"{CHANNELS}.u_heat.unit",
        ("give nominal, the power at 100 % in W",),
    ),
    "nominal of a temperature": (air(nominal=5), f"{CHANNELS}.T_i.nominal", ("is the power at 100 %",)),
    "rollover of a temperature": (air(rollover=5), f"{CHANNELS}.T_i.rollover", ("is for counters of energy",)),
    "energy of percent": (
        at("zones", 0, "channels", "u_heat", aggregate="energy"),
        f"{CHANNELS}.u_heat.aggregate",
        ("adds up amounts of energy",),
    ),
    "range of amounts": (
        at("zones", 0, "channels", "u_heat", aggregate="energy", unit="Wh", nominal=None, valid=[0, 5]),
        f"{CHANNELS}.u_heat.valid",
        ("amounts of energy do not have",),
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistake_is_one_sentence_at_its_place(name: str, tmp_path: Path) -> None:
    change, place, gist = MISTAKES[name]
    tables = modbus(tmp_path)
    change(tables)
    with pytest.raises(ConfigError) as caught:
        load(write(tmp_path, tables))
    here = [problem for problem in caught.value.problems if problem.startswith(f"{place}: ")]
    assert len(here) == 1, caught.value.problems
    for words in gist:
        assert words in here[0]
    assert "something else" not in here[0]


def test_a_mistake_in_a_source_is_not_repeated_for_its_channels(tmp_path: Path) -> None:
    tables = modbus(tmp_path)
    bms(order="XYZ")(tables)
    with pytest.raises(ConfigError) as caught:
        load(write(tmp_path, tables))
    assert len(caught.value.problems) == 1


def test_a_channel_of_an_unknown_source_is_told_so_and_nothing_else(tmp_path: Path) -> None:
    tables = modbus(tmp_path)
    air(source="bsm")(tables)
    with pytest.raises(ConfigError) as caught:
        load(write(tmp_path, tables))
    assert len(caught.value.problems) == 1
    assert 'there is no source "bsm"; the sources are log, bms' in caught.value.problems[0]


def test_the_line_to_add_is_of_the_kind_of_the_source(tmp_path: Path) -> None:
    tables = modbus(tmp_path)
    tables["zones"] = tables["zones"][:1]
    del tables["sources"]["log"], tables["zones"][0]["channels"]["T_out"]
    with pytest.raises(ConfigError) as caught:
        load(write(tmp_path, tables))
    (problem,) = caught.value.problems
    assert problem.endswith('T_out = { source = "...", register = 0, type = "float32", unit = "degC" }')


def test_a_counter_is_averaged_and_rolls_over_at_its_width(tmp_path: Path) -> None:
    tables = modbus(tmp_path)
    meter = {"source": "bms", "register": 5, "type": "uint32", "scale": 0.01, "unit": "kWh"}
    tables["zones"][0]["channels"]["u_heat"] = meter
    config = load(write(tmp_path, tables))
    assert config.zones[0].channels["u_heat"].aggregate == "mean"
    listed = {channel.id: channel for channel in config.build_source("bms")._listed}  # type: ignore[attr-defined]
    edge = listed["living/u_heat"].edge
    assert (edge.counter, edge.rollover, edge.conversion.scale) == (True, 2.0**32, 3.6e6)
    meter["rollover"] = 99_999_999
    config = load(write(tmp_path, tables))
    listed = {channel.id: channel for channel in config.build_source("bms")._listed}  # type: ignore[attr-defined]
    assert listed["living/u_heat"].edge.rollover == 99_999_999


def test_a_configuration_that_is_read_twice_equals_itself(tmp_path: Path) -> None:
    tables = modbus(tmp_path)
    bms(not_available=[math.nan, 0x8000])(tables)
    path = write(tmp_path, tables)
    assert load(path) == load(path), "otherwise a reload would find changes where there are none"
