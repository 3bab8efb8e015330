"""BACnet in the configuration: what is taken over from the source, and every mistake in one sentence."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from support.config_samples import sound, write
from support.config_spoiling import Change, at

from adapters.bacnet.config import BacnetChannelConfig
from adapters.bacnet.objects import ObjectId
from adapters.bacnet.source import BacnetSource
from service.config.load import load, load_sources
from service.config.written import effective_toml
from service.errors import ConfigError

CHANNELS = "zones[0] ('living').channels"


def bacnet(folder: Path) -> dict[str, Any]:
    """The sound configuration with its first zone on BACnet."""
    tables = sound(folder)
    tables["sources"]["bms"] = {"kind": "bacnet", "interface": "192.168.1.10/24", "device": 1201}
    tables["zones"][0]["channels"] = {
        "T_i": {"source": "bms", "object": "analog-input,1", "unit": "degC"},
        "T_out": {"source": "bms", "object": "Analog-Value:7", "device": 1300, "unit": "degF", "cov": False},
        "u_heat": {"source": "bms", "object": "binary-output,3", "unit": "%", "scale": 100, "nominal": 1500},
    }
    return tables


def air(**values: object) -> Change:
    return at("zones", 0, "channels", "T_i", **values)


def bms(**values: object) -> Change:
    return at("sources", "bms", **values)


def listed(folder: Path, tables: dict[str, Any]) -> dict[str, Any]:
    source = load(write(folder, tables)).build_source("bms")
    assert isinstance(source, BacnetSource)
    return {channel.id.removeprefix("living/"): channel for channel in source._listed}


def test_a_channel_takes_over_what_it_does_not_say(tmp_path: Path) -> None:
    tables = bacnet(tmp_path)
    bms(stuck_after="1h", at="192.168.1.20")(tables)
    channels = listed(tmp_path, tables)
    air, out, heat = (channels[name] for name in ("T_i", "T_out", "u_heat"))
    assert (air.device, air.object, air.address) == (1201, ObjectId(0, 1), "192.168.1.20")
    assert (air.unit, air.cov, air.stuck_after) == ("degC", True, 3600.0)
    assert (out.device, out.object, out.cov) == (1300, ObjectId(2, 7), False)
    assert out.address is None, "the address of the source is that of its own device"
    assert heat.unit is None, "what is scaled is not compared"
    assert heat.edge.value(1.0) == 1500.0
    assert air.edge.usual == (5.0, 40.0)


def test_units_are_compared_unless_that_is_not_wanted(tmp_path: Path) -> None:
    tables = bacnet(tmp_path)
    bms(compare_units=False)(tables)
    assert listed(tmp_path, tables)["T_i"].unit is None


def test_the_network_is_as_configured(tmp_path: Path) -> None:
    tables = bacnet(tmp_path)
    bms(port=47900, bbmd="10.0.0.1", ttl="2min", timeout="1s", retries=2, lifetime="1h", poll="30s")(tables)
    config = load(write(tmp_path, tables))
    source: Any = config.build_source("bms")
    network = source._network
    assert (network.interface, network.port, network.bbmd, network.ttl) == (
        "192.168.1.10/24",
        47900,
        "10.0.0.1:47808",
        120.0,
    )
    assert (network.timeout, network.retries) == (1.0, 2)
    assert (source._polling.poll, source._polling.lifetime) == (30.0, 3600.0)
    assert config.sources["bms"].described == (
        "BACnet/IP from 192.168.1.10/24 port 47900 through the BBMD 10.0.0.1:47808, polled every 30s"
    )


def test_what_show_config_prints_is_accepted_and_the_same(tmp_path: Path) -> None:
    first = load(write(tmp_path, bacnet(tmp_path)))
    channel = first.zones[0].channels["T_out"]
    assert isinstance(channel, BacnetChannelConfig)
    assert channel.address == "device 1300 analog-value,7"
    text = effective_toml(first)
    assert tomllib.loads(text)["zones"][0]["channels"]["T_out"]["object"] == "analog-value,7"
    (tmp_path / "again.toml").write_text(text, encoding="utf-8")
    assert effective_toml(load(tmp_path / "again.toml")) == text


def test_sources_can_be_read_without_zones(tmp_path: Path) -> None:
    path = tmp_path / "scan.toml"
    path.write_text('[sources.bms]\nkind = "bacnet"\ninterface = "192.168.1.10/24"\n', encoding="utf-8")
    assert [*load_sources(path)] == ["bms"]
    path.write_text('[sources.bms]\nkind = "bacnet"\n', encoding="utf-8")
    with pytest.raises(ConfigError, match=r"sources\.bms\.interface: is missing"):
        load_sources(path)


MISTAKES: dict[str, tuple[Change, str, tuple[str, ...]]] = {
    "no object": (air(object=None), f"{CHANNELS}.T_i.object", ("is missing; give the object whose present value",)),
    "no such type": (air(object="analog,1"), f"{CHANNELS}.T_i.object", ("analog-input,3", "accumulator")),
    "no instance": (air(object="analog-input"), f"{CHANNELS}.T_i.object", ("a type and an instance",)),
    "a number": (air(object=3), f"{CHANNELS}.T_i.object", ("in quotes", "not 3")),
    "an instance that is too large": (air(object="analog-input,9999999"), f"{CHANNELS}.T_i.object", ("0 to 4194302",)),
    "no device anywhere": (bms(device=None), f"{CHANNELS}.T_i", ("device is missing; give the device's instance",)),
    "at without a device": (bms(device=None, at="10.0.0.7"), "sources.bms", ("at says where device is",)),
    "no interface": (bms(interface=None), "sources.bms.interface", ("is missing; give this machine's address",)),
    "a name for an interface": (bms(interface="eth0"), "sources.bms.interface", ('192.168.1.10/24", not "eth0"',)),
    "a wrong BBMD": (bms(bbmd="bbmd.local"), "sources.bms.bbmd", ('192.168.1.20:47808", not "bbmd.local"',)),
    "a wrong address": (air(at="nowhere"), f"{CHANNELS}.T_i.at", ("behind a router", "2001:5")),
    "a short lifetime": (bms(lifetime="5s"), "sources.bms.lifetime", ("must be from 30s to 1d, not 5s",)),
    "nobody to ask": (bms(interface="192.168.1.10"), "sources.bms", ("nobody can be asked where device 1201 is",)),
    "unknown key": (bms(interfce="x"), "sources.bms.interfce", ('did you mean "interface"?',)),
    "a register": (air(register=3), f"{CHANNELS}.T_i.register", ("is not a known key", "object")),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_every_mistake_is_one_sentence_with_its_place(name: str, tmp_path: Path) -> None:
    change, place, words = MISTAKES[name]
    tables = bacnet(tmp_path)
    change(tables)
    with pytest.raises(ConfigError) as caught:
        load(write(tmp_path, tables))
    sentences = [sentence for sentence in str(caught.value).splitlines() if place in sentence]
    assert sentences, str(caught.value)
    for word in words:
        assert any(word in sentence for sentence in sentences), (word, sentences)


@pytest.mark.parametrize("where", ["10.0.0.7", "10.0.0.7:47809", "2001:5", "2001:0x0a0b0c"])
def test_addresses_of_every_kind_are_taken(where: str, tmp_path: Path) -> None:
    tables = bacnet(tmp_path)
    air(at=where)(tables)
    assert listed(tmp_path, tables)["T_i"].address == where


def test_the_library_is_imported_by_who_uses_it_only() -> None:
    code = "import sys, adapters.kinds, replay.bms.serving; sys.exit('bacpypes3' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=180).returncode == 0
