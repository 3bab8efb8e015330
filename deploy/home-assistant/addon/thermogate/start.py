"""The start of the add-on: a configuration from what the Supervisor tells, the recorder's history, the daemon, and the
states of the rooms' entities on the broker once a minute.

Options of the command line are those of `thermogate run`. What it needs of the Supervisor it finds in the environment.
"""

from __future__ import annotations

import http.client
import json
import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import paho.mqtt.client as paho
import tomli_w

from adapters.home_assistant.database import UNITS, as_number

SUPERVISOR = os.environ.get("SUPERVISOR_URL", "http://supervisor")
DATA = Path(os.environ.get("ADDON_DATA", "/data"))
RECORDER = Path(os.environ.get("HOMEASSISTANT_CONFIG", "/homeassistant")) / "home-assistant_v2.db"
EVERY = float(os.environ.get("TELEMETRY_SECONDS", "60"))
"""s between two readings of every entity."""
TOPIC = "thermogate-telemetry"
RATED = 1500.0
"""W of a heater whose power nobody has entered."""


class Told(Exception):
    """What is wrong, and the remedy, in one sentence."""


class Value(NamedTuple):
    """Where in Home Assistant the value of a channel is, and how to read it."""

    entity: str
    attribute: str | None
    settings: dict[str, Any]
    """Keys of the channel: unit, scale, nominal, aggregate."""


Room = dict[str, Value]
"""The values of a room by the names of their channels; `setpoint` is one of them."""


def say(sentence: str) -> None:
    """A line for the add-on's log."""
    print(f"thermogate: {sentence}", file=sys.stderr, flush=True)


def asked(path: str) -> Any:
    """What the Supervisor answers. Raises OSError."""
    headers = {"Authorization": f"Bearer {os.environ['SUPERVISOR_TOKEN']}"}
    try:
        with urllib.request.urlopen(urllib.request.Request(SUPERVISOR + path, headers=headers), timeout=30) as answer:
            return json.load(answer)
    except http.client.HTTPException as error:
        raise OSError(f"the answer broke off: {error!r}") from error


def running_house() -> dict[str, Any]:
    """The configuration of Home Assistant, as soon as it is up with all its entities."""
    waited = False
    while True:
        with suppress(OSError, ValueError):
            if (house := asked("/core/api/config")).get("state", "RUNNING") == "RUNNING":
                return house
        if not waited:
            say("waits for Home Assistant to start")
            waited = True
        time.sleep(min(5.0, EVERY))


def broker() -> dict[str, Any]:
    """The broker of the Supervisor, as the tables of Thermogate name one. Raises Told."""
    try:
        found = asked("/services/mqtt")["data"]
    except OSError as error:
        raise Told(f"the Supervisor knows no MQTT broker ({error}); install the add-on Mosquitto broker") from error
    table: dict[str, Any] = {"host": found["host"], "port": int(found["port"])}
    if found.get("username"):
        secret = DATA / "mqtt-password"
        secret.touch(mode=0o600)
        secret.write_text(found.get("password") or "", encoding="utf-8")
        table |= {"user": found["username"], "password_file": str(secret)}
    return table | ({"tls": {}} if found.get("ssl") else {})


def state_of(entity: str) -> dict[str, Any] | None:
    """State and attributes of an entity; None where there is none. Raises OSError where nobody answers."""
    try:
        return asked(f"/core/api/states/{entity}")
    except urllib.error.HTTPError as error:
        with error:
            if error.code == 404:
                return None
            raise


def seen(entity: str) -> dict[str, Any]:
    """State and attributes of an entity. Raises Told where there is none, and where nobody answers."""
    try:
        state = state_of(entity)
    except (OSError, ValueError) as error:
        raise Told(f"Home Assistant does not say what '{entity}' is ({error}); restart this add-on") from error
    if state is None:
        raise Told(f"Home Assistant has no entity '{entity}'; choose one of Developer tools, States")
    return state


def temperature(entity: str, attribute: str, house: Mapping[str, Any]) -> Value:
    """The state of a sensor, or an attribute of another entity. Raises Told where it is no temperature."""
    attributes = seen(entity)["attributes"]
    if entity.startswith("sensor."):
        found, unit = None, attributes.get("unit_of_measurement")
    elif attribute in attributes:
        found, unit = attribute, attributes.get("temperature_unit", house["unit_system"]["temperature"])
    else:
        raise Told(f"'{entity}' has no {attribute}; give a sensor of the temperature instead")
    if UNITS.get(unit) not in ("degC", "degF", "K"):
        raise Told(f"'{entity}' is in {unit or 'no unit'}, which is no temperature; give another entity")
    return Value(entity, found, {"unit": UNITS[unit]})


def heating(entity: str, power: float) -> Value:
    """How much an entity heats, of `power` W at most. Raises Told where it does not tell."""
    attributes = seen(entity)["attributes"]
    stated = attributes.get("unit_of_measurement")
    unit = UNITS.get(stated)
    on = {"unit": "W", "scale": power, "aggregate": "mean"}
    if entity.startswith("climate."):
        if "hvac_action" not in attributes:
            raise Told(
                f"'{entity}' does not tell whether it heats; enter for `heating` a power sensor, a valve in percent "
                "or a switch"
            )
        return Value(entity, "hvac_action", on)
    if unit == "%":
        return Value(entity, None, {"unit": "%", "nominal": power, "aggregate": "mean"})
    if unit in ("W", "kW", "MW", "BTU/h"):
        return Value(entity, None, {"unit": unit, "aggregate": "mean"})
    if unit in ("Wh", "kWh", "MWh", "MJ", "GJ"):
        return Value(entity, None, {"unit": unit})
    if stated:
        raise Told(
            f"'{entity}' is in {stated}, which is no heat; enter for `heating` a power sensor, a meter of energy, a "
            "valve in percent or a switch"
        )
    return Value(entity, None, on)


def described(room: Mapping[str, Any], outdoor: str, house: Mapping[str, Any]) -> Room:
    """The channels of a room of the options. Raises Told."""
    thermostat = room["thermostat"]
    values = {
        "T_i": temperature(thermostat, "current_temperature", house),
        "T_out": temperature(outdoor, "temperature", house),
        "u_heat": heating(room.get("heating") or thermostat, room.get("power") or RATED),
    }
    if thermostat.startswith("climate.") and "temperature" in seen(thermostat)["attributes"]:
        values["setpoint"] = temperature(thermostat, "temperature", house)
    return values


def rooms_of(options: Mapping[str, Any], house: Mapping[str, Any]) -> dict[str, Room]:
    """The rooms that can be run. One with a fault is left out with a sentence, or stays as it was described before."""
    memory = DATA / "rooms.json"
    known = json.loads(memory.read_text(encoding="utf-8")) if memory.is_file() else {}
    rooms: dict[str, Room] = {}
    for room in options["rooms"]:
        name, entry = room["name"], json.dumps([room, options["outdoor"]])
        if name in rooms:
            say(f"room {name}: another room has that name; give each its own in the configuration tab")
            continue
        try:
            rooms[name] = described(room, options["outdoor"], house)
            known[name] = [entry, rooms[name]]
        except Told as fault:
            before, values = known.get(name, (None, {}))
            if before == entry:
                rooms[name] = {channel: Value(*value) for channel, value in values.items()}
            say(f"room {name}: {fault}" + ("; it stays as it was" if before == entry else ""))
    memory.write_text(json.dumps(known), encoding="utf-8")
    return rooms


def tables(rooms: Mapping[str, Room], source: str, places: Mapping[str, Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """The tables [[zones]] of `rooms`, whose values are at `places`, by room and channel."""
    for name, room in rooms.items():
        channels = {
            channel: {"source": source, **places[name][channel], **value.settings} for channel, value in room.items()
        }
        setpoint = {"setpoint": channels.pop("setpoint")} if "setpoint" in channels else {}
        yield {"id": name, "channels": channels, **setpoint}


def configured(house: Mapping[str, Any], host: Mapping[str, Any], rooms: Mapping[str, Room]) -> tuple[Path, Path]:
    """The configuration of the daemon and that of the history, written."""
    topics = {
        name: {channel: {"topic": f"{TOPIC}/{name}", "value": f"/{channel}"} for channel in room}
        for name, room in rooms.items()
    }
    entities = {
        name: {
            channel: {"entity": value.entity, **({"attribute": value.attribute} if value.attribute else {})}
            for channel, value in room.items()
        }
        for name, room in rooms.items()
    }
    site = {"id": "home", "state_dir": str(DATA / "state"), "time_zone": house["time_zone"]}
    site |= {key: house[key] for key in ("latitude", "longitude", "country") if house.get(key)}
    language = "de" if house.get("language", "").startswith("de") else "en"
    live = {
        "site": site,
        "zenoh": {"enabled": False},
        "mqtt": {**host, "home_assistant": True, "language": language},
        "sources": {"home": {"kind": "mqtt", **host, "format": "json", "time": "/time"}},
        "zones": [{"period": "5min", "network": "auto", **zone} for zone in tables(rooms, "home", topics)],
    }
    past = {
        "sources": {"recorder": {"kind": "home-assistant", "file": str(RECORDER)}},
        "zones": list(tables(rooms, "recorder", entities)),
    }
    paths = DATA / "thermogate.toml", DATA / "history.toml"
    for path, document in zip(paths, (live, past), strict=True):
        path.write_text(tomli_w.dumps(document), encoding="utf-8")
    return paths


class Feeder:
    """Puts the values of the rooms on the broker."""

    def __init__(self, host: Mapping[str, Any], rooms: Mapping[str, Room]) -> None:
        self._rooms = rooms
        self._client = paho.Client(paho.CallbackAPIVersion.VERSION2, client_id=TOPIC)
        if "user" in host:
            self._client.username_pw_set(host["user"], Path(host["password_file"]).read_text(encoding="utf-8"))
        if "tls" in host:
            self._client.tls_set()
        # What is older is worth nothing when the broker is back; the daemon says that it is away.
        self._client.max_queued_messages_set(len(rooms))
        self._client.connect_async(host["host"], host["port"])
        self._client.loop_start()
        self._missing: set[str] = set()

    def feed(self) -> None:
        """Publish what every entity says now. Says once what is missing, and once that it is back."""
        states: dict[str, Any] = {}
        missing = set()
        try:
            for entity in {value.entity for room in self._rooms.values() for value in room.values()}:
                states[entity] = state_of(entity)
                if states[entity] is None or states[entity]["state"] in ("unavailable", "unknown"):
                    missing.add(f"entity '{entity}' has no value")
            self._publish(states)
        except (OSError, ValueError) as error:
            missing.add(f"Home Assistant does not answer ({error})")
        for sentence in sorted(missing - self._missing):
            say(f"{sentence}; look at it in Home Assistant")
        for sentence in sorted(self._missing - missing):
            say(f"no longer: {sentence}")
        self._missing = missing

    def _publish(self, states: Mapping[str, Any]) -> None:
        now = datetime.now(UTC).isoformat()
        for name, room in self._rooms.items():
            told = {channel: self._number(value, states[value.entity]) for channel, value in room.items()}
            values = {channel: value for channel, value in told.items() if isfinite(value)}
            self._client.publish(f"{TOPIC}/{name}", json.dumps({"time": now, **values}), qos=1)

    @staticmethod
    def _number(value: Value, state: Mapping[str, Any] | None) -> float:
        if state is None:
            return float("nan")
        return as_number(state["attributes"].get(value.attribute) if value.attribute else state["state"])


def account() -> dict[str, Any]:
    """Of the processes that are no longer root's; DATA becomes theirs."""
    if not (number := int(os.environ.get("DAEMON_USER", "0"))):
        return {}
    for path in (DATA, *DATA.rglob("*")):
        if path.name != "options.json":
            os.chown(path, number, number, follow_symlinks=False)
    return {"user": number, "group": number, "extra_groups": []}


def main() -> int:
    """Run until the daemon ends or a signal comes; the exit status is the daemon's."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    options = json.loads((DATA / "options.json").read_text(encoding="utf-8"))
    house = running_house()
    try:
        host = broker()
        if not options["rooms"] or not options["outdoor"]:
            raise Told("there is nothing to learn yet; enter outdoor temperature and rooms in the configuration tab")
        if not (rooms := rooms_of(options, house)):
            raise Told("no room can be run; correct the rooms in the configuration tab")
    except Told as fault:
        say(str(fault))
        return 1
    config, history = configured(house, host, rooms)
    changes, who = sys.argv[1:], account()
    if RECORDER.is_file():
        # What the zones know already is passed over, so that it fills every gap that a stop has left.
        command = ["thermogate", "learn", str(config), "--from", str(history), "--out", str(DATA), *changes]
        if subprocess.run(command, check=False, **who).returncode:
            say("the history could not be learned, the sentence above says why; the rooms learn from now on")
    else:
        say(f"the recorder has no database {RECORDER.name}; the rooms learn from now on")
    with subprocess.Popen(["thermogate", "run", str(config), *changes], **who) as daemon:
        signal.signal(signal.SIGTERM, lambda *_: daemon.terminate())
        feeder = Feeder(host, rooms)
        while daemon.poll() is None:
            feeder.feed()
            with suppress(subprocess.TimeoutExpired):
                daemon.wait(EVERY)
    return daemon.returncode


if __name__ == "__main__":
    sys.exit(main())
