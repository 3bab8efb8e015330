"""MQTT sources in the configuration: what is taken over from the source, and every mistake in one sentence."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
from support.config_samples import sound, write
from support.config_spoiling import Change, at

from adapters.credentials import Tls
from adapters.mqtt.config import MqttChannelConfig
from service.cli.main import main
from service.config.load import load
from service.config.written import effective_toml
from service.errors import ConfigError

CHANNELS = "zones[0] ('living').channels"
HOME = "sources.home"


def mqtt(folder: Path) -> dict[str, Any]:
    """The sound configuration with its first zone on MQTT."""
    tables = sound(folder)
    tables["sources"]["home"] = {"kind": "mqtt", "host": "10.0.0.5", "value": "/v", "time": "/t"}
    tables["zones"][0]["channels"] = {
        "T_i": {"source": "home", "topic": "home/T", "format": "json", "unit": "degC"},
        "T_out": {"source": "home", "topic": "home/out", "unit": "degC"},
        "u_heat": {"source": "home", "topic": "home/pack", "format": "senml", "record": "u", "unit": "kW"},
    }
    return tables


def home(**values: object) -> Change:
    return at("sources", "home", **values)


def air(**values: object) -> Change:
    return at("zones", 0, "channels", "T_i", **values)


def test_what_a_channel_waits_for_at_the_broker_depends_on_its_time(tmp_path: Path) -> None:
    config = load(write(tmp_path, mqtt(tmp_path)))
    source: Any = config.build_source("home")
    assert source._topics() == {"home/T": 1, "home/out": 0, "home/pack": 1}
    tables = mqtt(tmp_path)
    home(qos=1)(tables)
    source = load(write(tmp_path, tables)).build_source("home")
    assert set(source._topics().values()) == {1}
    tables = mqtt(tmp_path)
    home(times=["arrival"])(tables)
    source = load(write(tmp_path, tables)).build_source("home")
    assert set(source._topics().values()) == {0}, "the time in the payload is not used"


def test_a_channel_takes_over_what_its_format_has(tmp_path: Path) -> None:
    channels = load(write(tmp_path, mqtt(tmp_path))).zones[0].channels
    air_, out, heat = (channels[name] for name in ("T_i", "T_out", "u_heat"))
    assert isinstance(air_, MqttChannelConfig)
    assert isinstance(out, MqttChannelConfig)
    assert (air_.payload_format.value, air_.payload_format.time) == (("v",), ("t",))
    assert (out.format, out.value, out.time) == ("plain", None, None)
    assert [channel.address for channel in (air_, out, heat)] == [
        "home/T json /v",
        "home/out plain",
        "home/pack senml u",
    ]


def test_the_broker_knows_the_source_by_site_and_name(tmp_path: Path) -> None:
    source: Any = load(write(tmp_path, mqtt(tmp_path))).build_source("home")
    broker = source._broker
    assert (broker.client_id, broker.place, broker.version) == ("thermogate-house-home", "mqtt://10.0.0.5:1883", "5")
    tables = mqtt(tmp_path)
    home(tls={}, client_id="mine", version="3.1.1", host="::1")(tables)
    source = load(write(tmp_path, tables)).build_source("home")
    assert (source._broker.client_id, source._broker.place) == ("mine", "mqtts://[::1]:8883")
    assert source._broker.tls == Tls()
    assert source._broker.credentials() == (None, None)


def test_what_show_config_writes_is_read_again_and_has_no_password(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HOME_PASSWORD", "do-not-tell")
    tables = mqtt(tmp_path)
    home(user="thermogate", password_env="HOME_PASSWORD", session="2h")(tables)
    tables["mqtt"] = {"host": "10.0.0.5", "user": "thermogate", "password_env": "HOME_PASSWORD"}
    path = write(tmp_path, tables)
    config = load(path)
    again = tmp_path / "again.toml"
    again.write_text(effective_toml(config), encoding="utf-8")
    assert effective_toml(load(again)) == effective_toml(config)
    assert main(["show-config", str(path)]) == 0
    assert main(["check", str(path)]) == 0
    shown = capsys.readouterr()
    assert "do-not-tell" not in shown.out + shown.err
    assert "source home: mqtt, mqtt://10.0.0.5:1883, MQTT 5" in shown.out
    written = tomllib.loads(again.read_text(encoding="utf-8"))
    assert written["sources"]["home"]["session"] == "2h"
    assert written["mqtt"]["host"] == "10.0.0.5"
    without = effective_toml(load(write(tmp_path, sound(tmp_path))))
    assert "host" not in tomllib.loads(without)["mqtt"]


MISTAKES = [
    (home(host=None), f"{HOME}.host", "is missing; give the broker"),
    (home(port=0), f"{HOME}.port", "from 1 to 65535"),
    (home(version=5), f"{HOME}.version", '"5" or "3.1.1"'),
    (home(user="x"), HOME, "user goes with the password's place"),
    (home(user="x", password_env="X", password_file="y"), HOME, "one of password_file and password_env"),
    (home(user="x", password_file="nothing"), HOME, "password_file: "),
    (home(password="secret"), f"{HOME}.password", "is not a known key"),
    (home(tls={"certificate": "a.pem"}), f"{HOME}.tls", "give both, or neither"),
    (home(tls={"ca": "nothing.pem"}), HOME, "tls.ca: "),
    (home(tls=True), f"{HOME}.tls", "table"),
    (home(times=["zenoh"]), f"{HOME}.times[0]", '"payload" or "arrival"'),
    (home(times=["arrival", "arrival"]), f"{HOME}.times", "the same time twice"),
    (home(qos=2), f"{HOME}.qos", "from 0 to 1"),
    (home(queue=0), f"{HOME}.queue", "from 1 to 100000"),
    (home(session="long"), f"{HOME}.session", "duration"),
    (home(keepalive="0s"), f"{HOME}.keepalive", "longer than 0"),
    (home(timeout="2h"), f"{HOME}.timeout", "must be at most 1min"),
    (home(status_topic="home/#"), f"{HOME}.status_topic", "has a wildcard (+ or #)"),
    (air(topic=None), f"{CHANNELS}.T_i.topic", "is missing; give the topic"),
    (air(topic="home/+/T"), f"{CHANNELS}.T_i.topic", "has a wildcard (+ or #); name one topic for each channel"),
    (air(topic=""), f"{CHANNELS}.T_i.topic", "must be a text in quotes"),
    (air(record="x"), f"{CHANNELS}.T_i", 'record is for format "senml", not "json"'),
    (air(format="plain", value="/v"), f"{CHANNELS}.T_i", 'format "plain" has no value'),
    (air(key="home/T"), f"{CHANNELS}.T_i.key", "is not a known key"),
]


@pytest.mark.parametrize(
    ("change", "place", "gist"), MISTAKES, ids=lambda value: value if isinstance(value, str) else ""
)
def test_mistake_is_one_sentence_at_its_place(change: Change, place: str, gist: str, tmp_path: Path) -> None:
    tables = mqtt(tmp_path)
    change(tables)
    with pytest.raises(ConfigError) as mistakes:
        load(write(tmp_path, tables))
    (problem,) = mistakes.value.problems
    assert problem.startswith(f"{place}: ")
    assert gist in problem
    assert "pydantic" not in problem
