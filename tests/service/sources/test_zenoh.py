"""Zenoh sources in the configuration: what is taken over from the source, and every mistake in one sentence."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
from support.config_samples import sound, write
from support.config_spoiling import Change, at

from adapters.zenoh.config import ZenohChannelConfig
from service.cli.main import main
from service.config.load import load
from service.config.written import effective_toml
from service.errors import ConfigError

CHANNELS = "zones[0] ('living').channels"
BMS = "sources.bms"


def zenoh(folder: Path) -> dict[str, Any]:
    """The sound configuration with its first zone on Zenoh."""
    tables = sound(folder)
    tables["sources"]["bms"] = {"kind": "zenoh", "connect": ["tcp/10.0.0.5:7447"], "value": "/v", "time": "/t"}
    tables["zones"][0]["channels"] = {
        "T_i": {"source": "bms", "key": "bms/T", "format": "json", "unit": "degC"},
        "T_out": {"source": "bms", "key": "bms/out", "unit": "degC"},
        "u_heat": {"source": "bms", "key": "bms/pack", "format": "senml", "record": "u", "unit": "kW"},
    }
    return tables


def bms(**values: object) -> Change:
    return at("sources", "bms", **values)


def air(**values: object) -> Change:
    return at("zones", 0, "channels", "T_i", **values)


def test_a_channel_takes_over_what_its_format_has(tmp_path: Path) -> None:
    tables = zenoh(tmp_path)
    bms(good=["OK", 192, True], time_format="epoch", stuck_after="1h", quality="/q")(tables)
    air(value="/present/value")(tables)
    channels = load(write(tmp_path, tables)).zones[0].channels
    air_, out, heat = (channels[name] for name in ("T_i", "T_out", "u_heat"))
    assert isinstance(air_, ZenohChannelConfig)
    assert isinstance(out, ZenohChannelConfig)
    assert isinstance(heat, ZenohChannelConfig)
    form = air_.payload_format
    assert (form.value, form.time, form.quality, form.time_format) == (("present", "value"), ("t",), ("q",), "epoch")
    assert form.good == {"ok", "192", "true"}
    assert air_.stuck_after == 3600.0
    assert (out.format, out.value, out.time, out.quality) == ("plain", None, None, None)
    assert (heat.payload_format.record, heat.payload_format.quality, heat.time) == ("u", ("q",), None)
    assert heat.payload_format.unit == "kW"
    assert air_.address == "bms/T json /present/value"


def test_the_unit_of_a_record_is_not_compared_where_the_number_is_scaled(tmp_path: Path) -> None:
    tables = zenoh(tmp_path)
    at("zones", 0, "channels", "u_heat", scale=0.001)(tables)
    channel = load(write(tmp_path, tables)).zones[0].channels["u_heat"]
    assert isinstance(channel, ZenohChannelConfig)
    assert channel.payload_format.unit is None


def test_what_show_config_writes_is_read_again_and_has_no_password(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("BMS_PASSWORD", "do-not-tell")
    tables = zenoh(tmp_path)
    bms(user="thermogate", password_env="BMS_PASSWORD", recover="5min")(tables)
    path = write(tmp_path, tables)
    config = load(path)
    again = tmp_path / "again.toml"
    again.write_text(effective_toml(config), encoding="utf-8")
    assert effective_toml(load(again)) == effective_toml(config)
    assert main(["show-config", str(path)]) == 0
    assert main(["check", str(path)]) == 0
    shown = capsys.readouterr()
    assert "do-not-tell" not in shown.out + shown.err
    assert "source bms: zenoh, client connecting to tcp/10.0.0.5:7447" in shown.out
    assert tomllib.loads(again.read_text(encoding="utf-8"))["sources"]["bms"]["recover"] == "5min"


MISTAKES = [
    (bms(connect=None), BMS, "needs connect"),
    (bms(connect=["10.0.0.5:7447"]), f"{BMS}.connect", "write protocol/host:port"),
    (bms(connect=["tcp/10.0.0.5:99999"]), f"{BMS}.connect", "is not an endpoint"),
    (bms(listen=["tcp/127.0.0.1:0"]), BMS, 'mode "client" only connects'),
    (bms(mode="routr"), f"{BMS}.mode", '"peer", "client" or "router"'),
    (bms(mode="router", listen=["tcp/0.0.0.0:7447"], writers=["*"]), BMS, "lets other machines in: give users_file"),
    (bms(mode="router", listen=["tcp/127.0.0.1:7447"]), BMS, "say in writers"),
    (bms(mode="router", listen=["tcp/127.0.0.1:7447"], writers=["bms"]), BMS, "has no name; give users_file"),
    (bms(writers=["*", "bms"]), BMS, "lets everyone put readings"),
    (bms(writers=[]), f"{BMS}.writers", "a list of user names and common names"),
    (bms(connect=["udp/224.0.0.224:7446"]), f"{BMS}.connect", "is a multicast address"),
    (bms(mode="peer", listen=["tls/127.0.0.1:7447"]), BMS, "needs tls.certificate and tls.private_key"),
    (bms(user="x"), BMS, "user goes with the password's place"),
    (bms(password_env="X"), BMS, "user goes with the password's place"),
    (bms(user="x", password_env="X", password_file="y"), BMS, "one of password_file and password_env"),
    (bms(password="secret"), f"{BMS}.password", "is not a known key"),
    (bms(tls={"certificate": "a.pem"}), f"{BMS}.tls", "give both, or neither"),
    (bms(tls={"ca": "nothing.pem"}), BMS, "tls.ca: "),
    (bms(times=[]), f"{BMS}.times", "a list of payload, zenoh, arrival"),
    (bms(times=["arival"]), f"{BMS}.times", '"payload", "zenoh" or "arrival"'),
    (bms(times=["zenoh", "zenoh"]), f"{BMS}.times", "the same time twice"),
    (bms(times=["arrival"], recover="1min"), BMS, "recover brings samples long after"),
    (bms(queue=0), f"{BMS}.queue", "from 1 to 100000"),
    (bms(timeout="2h"), f"{BMS}.timeout", "must be at most 1min"),
    (bms(time="t"), f"{BMS}.time", "begin it with /"),
    (bms(good="good"), f"{BMS}.good", "a list of what stands for it"),
    (bms(good=[[1]]), f"{BMS}.good", "must be a text, a number, true or false"),
    (air(key=None), f"{CHANNELS}.T_i.key", "is missing; give the key expression"),
    (air(key="bms//T"), BMS, 'living/T_i: key "bms//T" is no key expression'),
    (air(format="xml"), f"{CHANNELS}.T_i.format", '"plain", "json" or "senml"'),
    (air(value="v"), f"{CHANNELS}.T_i.value", "is no JSON pointer"),
    (air(value=1), f"{CHANNELS}.T_i.value", "must be a JSON pointer in quotes"),
    (air(record="x"), f"{CHANNELS}.T_i", 'record is for format "senml", not "json"'),
    (air(format="plain", value="/v"), f"{CHANNELS}.T_i", 'format "plain" has no value'),
    (air(format="senml", time="/v"), f"{CHANNELS}.T_i", 'format "senml" has no time'),
    (air(time_zone="Europe/Berlinn"), f"{CHANNELS}.T_i.time_zone", "Europe/Berlin"),
    (air(register=3), f"{CHANNELS}.T_i.register", "is not a known key"),
]


@pytest.mark.parametrize(("change", "place", "gist"), MISTAKES)
def test_a_mistake_is_one_sentence_with_its_place(change: Change, place: str, gist: str, tmp_path: Path) -> None:
    tables = zenoh(tmp_path)
    change(tables)
    with pytest.raises(ConfigError) as caught:
        load(write(tmp_path, tables))
    here = [problem for problem in caught.value.problems if problem.startswith(place) and gist in problem]
    assert len(here) == 1, caught.value.problems
    for problem in caught.value.problems:
        assert "\n" not in problem
        assert "secret" not in problem
        assert "Input should" not in problem


def test_listening_for_other_machines_takes_credentials(tmp_path: Path) -> None:
    (tmp_path / "users").write_text("bms:secret\n", encoding="utf-8")
    tables = zenoh(tmp_path)
    bms(mode="router", listen=["tcp/0.0.0.0:7447"], users_file="users", writers=["bms"])(tables)
    assert load(write(tmp_path, tables)).sources["bms"].described == (
        "router connecting to tcp/10.0.0.5:7447 and listening on tcp/0.0.0.0:7447"
    )
