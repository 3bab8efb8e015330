"""The add-on for Home Assistant: its folder by the Supervisor's rules, and its start beside real peers."""

import json
import math
import os
import re
import struct
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from support.broker import Mosquitto, Party, broker
from support.harness import ROOT, ask
from support.processes import Program, program
from support.recorder import database
from support.waiting import PATIENCE, wait_until
from support.web_answers import answering

REPOSITORY = ROOT / "deploy" / "home-assistant" / "addon"
FOLDER = REPOSITORY / "thermogate"
CONFIG = yaml.safe_load((FOLDER / "config.yaml").read_text(encoding="utf-8"))
TOKEN = "of-the-supervisor"
ATTIC = {"name": "attic", "thermostat": "climate.attic"}

RULES = yaml.safe_load(Path(__file__).with_name("supervisor.yaml").read_text(encoding="utf-8"))


def test_it_follows_the_rules_of_the_supervisor() -> None:
    jsonschema.validate(CONFIG, RULES)
    assert set(CONFIG["options"]) == set(CONFIG["schema"])
    image = r"^([a-zA-Z\-.:\d{}]+/)*?([-\w{}]+)/([-\w{}]+)(:[.\-\w{}]+)?$"
    built = yaml.safe_load((FOLDER / "build.yaml").read_text(encoding="utf-8"))["build_from"]
    assert set(built) == set(CONFIG["arch"])
    assert all(re.match(image, base) for base in built.values())
    assert set(yaml.safe_load((REPOSITORY / "repository.yaml").read_text(encoding="utf-8"))) == {"name", "maintainer"}
    for name in ("DOCS.md", "README.md", "CHANGELOG.md", "Dockerfile"):
        assert (FOLDER / name).read_text(encoding="utf-8").strip(), name


def test_it_has_the_version_of_the_project_and_pictures_of_the_sizes_that_are_shown() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert CONFIG["version"] == version
    assert f"## {version}\n" in (FOLDER / "CHANGELOG.md").read_text(encoding="utf-8")
    for name, size in (("icon.png", (128, 128)), ("logo.png", (250, 100))):
        head = (FOLDER / name).read_bytes()[:24]
        assert (head[:8], struct.unpack(">II", head[16:24])) == (b"\x89PNG\r\n\x1a\n", size)


@pytest.mark.parametrize("language", ["en", "de"])
def test_every_option_is_explained(language: str) -> None:
    texts = yaml.safe_load((FOLDER / "translations" / f"{language}.yaml").read_text(encoding="utf-8"))["configuration"]
    assert set(texts) == set(CONFIG["schema"])
    assert all(set(text) == {"name", "description"} for text in texts.values())
    for field in CONFIG["schema"]["rooms"][0]:
        assert f"{field}:" in texts["rooms"]["description"]


class House:
    """The Supervisor's interface as far as the add-on asks it: the broker, and Home Assistant's configuration and
    states, which a test can change while they are asked for."""

    def __init__(self) -> None:
        self.url = ""
        self.broken = False
        """Whether no answer is one of HTTP."""
        self.mqtt: dict[str, Any] | None = None
        self.states: dict[str, tuple[str, dict[str, Any]]] = {
            "weather.home": ("sunny", {"temperature": 41.0, "temperature_unit": "°F"}),
            "climate.living": ("heat", {"current_temperature": 68.0, "temperature": 70.0, "hvac_action": "heating"}),
            "climate.attic": ("heat", {"temperature": 70.0}),
            "climate.bath": ("heat", {"current_temperature": 68.0}),
            "sensor.flow": ("300", {"unit_of_measurement": "L/h"}),
        }

    def answer(self, path: str, authorization: str | None) -> tuple[int, bytes]:
        if self.broken:
            return 0, b""
        status, found = self._found(path) if authorization == f"Bearer {TOKEN}" else (401, {"result": "error"})
        return status, json.dumps(found).encode()

    def _found(self, path: str) -> tuple[int, Any]:
        if path == "/services/mqtt":
            return (200, {"result": "ok", "data": self.mqtt}) if self.mqtt else (400, {"result": "error"})
        if path == "/core/api/config":
            place = {"latitude": 47.7, "longitude": 9.2, "time_zone": "Europe/Berlin", "country": "DE"}
            return 200, {"state": "RUNNING", "unit_system": {"temperature": "°F"}, **place}
        entity = path.removeprefix("/core/api/states/")
        if entity == "climate.slow":
            return 502, {"message": "Bad Gateway"}
        if entity not in self.states:
            return 404, {"message": "Entity not found."}
        state, attributes = self.states[entity]
        return 200, {"entity_id": entity, "state": state, "attributes": attributes}


@pytest.fixture
def house() -> Iterator[House]:
    running = House()
    with answering(running.answer) as running.url:
        yield running


@pytest.fixture
def site(tmp_path: Path, house: House) -> Iterator[Mosquitto]:
    """A broker that takes one user, which the Supervisor knows."""
    passwords = tmp_path / "passwords"
    subprocess.run([program("mosquitto_passwd", "mosquitto"), "-b", "-c", passwords, "addons", "secret"], check=True)
    with broker(tmp_path, "allow_anonymous false", f"password_file {passwords}") as running:
        house.mqtt = {"host": "127.0.0.1", "port": running.port, "ssl": False, "protocol": "3.1.1"}
        house.mqtt |= {"username": "addons", "password": "secret"}
        yield running


class Addon(Program):
    """The start script in an environment such as the Supervisor's."""

    def __init__(self, folder: Path, house: House, rooms: list[dict[str, Any]], *options: str) -> None:
        data = folder / "data"
        data.mkdir(exist_ok=True)
        (data / "options.json").write_text(json.dumps({"outdoor": "weather.home", "rooms": rooms}))
        environment = os.environ | {
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
            "SUPERVISOR_TOKEN": TOKEN,
            "SUPERVISOR_URL": house.url,
            "ADDON_DATA": str(data),
            "HOMEASSISTANT_CONFIG": str(folder),
            "TELEMETRY_SECONDS": "0.2",
        }
        (folder / "addon.log").unlink(missing_ok=True)
        command = [sys.executable, FOLDER / "start.py", "--set", "http.port=0", *options]
        super().__init__(command, folder / "addon.log", env=environment)

    def __exit__(self, *_: object) -> None:
        self.terminate()


def kept(folder: Path, hours: int) -> None:
    """The recorder's database of a thermostat in °F over the last `hours`, with a state every ten seconds."""
    began, rows = time.time() - 3600 * hours, []
    for step in range(360 * hours):
        minute = step / 6
        warmth, action = 68 + 2 * math.sin(minute / 60 * math.tau), "heating" if minute % 60 < 20 else "idle"
        living = {"current_temperature": round(warmth, 1), "temperature": 70.0, "hvac_action": action}
        outdoor = {"temperature": round(41 + 9 * math.sin(minute / 1440 * math.tau), 1), "temperature_unit": "°F"}
        rows.append((10 * step, "climate.living", ("heat", json.dumps(living))))
        rows.append((10 * step, "weather.home", ("sunny", json.dumps(outdoor))))
    database(folder / "home-assistant_v2.db", rows, began=began)


def party(site: Mosquitto, *topics: str) -> Party:
    return Party(site.port, *topics, connect=lambda client: client.username_pw_set("addons", "secret"))


def test_from_the_options_to_a_forecast_of_a_room_with_history(tmp_path: Path, house: House, site: Mosquitto) -> None:
    kept(tmp_path, hours=1)
    rooms = [
        {"name": "living", "thermostat": "climate.living", "power": 1200.0},
        ATTIC,
        {"name": "bath", "thermostat": "climate.bath"},
        {"name": "cellar", "thermostat": "climate.cellar"},
        {"name": "living", "thermostat": "sensor.flow"},
        {"name": "hall", "thermostat": "climate.living", "heating": "sensor.flow"},
        {"name": "office", "thermostat": "climate.slow"},
    ]
    changes = ('zones.living.estimator="ekf"', 'zones.living.period="10s"', 'zones.living.lateness="1s"')
    quick = [word for change in changes for word in ("--set", change)]
    ahead, telemetry = "thermogate/home/living/ahead", "thermogate-telemetry/living"
    with (
        party(site, ahead, telemetry, "homeassistant/#") as listening,
        Addon(tmp_path, house, rooms, *quick) as running,
    ):
        running.says("serving on")
        said = running.log()
        assert "room attic: 'climate.attic' has no current_temperature; give a sensor of the temperature" in said
        assert "room bath: 'climate.bath' does not tell whether it heats; enter for `heating` a power sensor" in said
        assert "room living: another room has that name; give each its own in the configuration tab" in said
        assert "room hall: 'sensor.flow' is in L/h, which is no heat; enter for `heating` a power sensor" in said
        assert "room office: Home Assistant does not say what 'climate.slow' is (HTTP Error 502: Bad Gateway)" in said
        assert "room cellar: Home Assistant has no entity 'climate.cellar'; choose one of" in said
        assert "history could not be learned" not in said
        wait_until(lambda: {ahead, telemetry} < listening.newest().keys())
        # An hour in degF has been learned, so that the first live interval need not be waited for.
        assert 12.0 < json.loads(listening.newest()[ahead])["outputs"][0]["horizons"][0]["mean"] < 28.0
        told = json.loads(listening.newest()[telemetry])
        assert datetime.fromisoformat(told.pop("time")) - datetime.now(UTC) < timedelta(minutes=5)
        assert told == {"T_i": 68.0, "T_out": 41.0, "u_heat": 1.0, "setpoint": 70.0}
        url = running.says(r"serving on (\S+)")[1]
        status = lambda: ask(f"{url}/zones/living")[1]["status"]  # noqa: E731
        wait_until(lambda: all(one["last_good"] for one in status()["channels"]))
        assert status()["faults"] == {}
        house.states["climate.living"] = ("unavailable", {})
        running.says("entity 'climate.living' has no value; look at it in Home Assistant")
        house.states["climate.living"] = ("heat", {"current_temperature": 69.0, "hvac_action": "idle"})
        running.says("no longer: entity 'climate.living' has no value")
        house.broken = True
        running.says(r"Home Assistant does not answer \(the answer broke off: BadStatusLine")
        house.broken = False
        running.says("no longer: Home Assistant does not answer")
        wait_until(lambda: json.loads(listening.newest()[telemetry]).get("T_i") == 69.0)
    assert running.process.returncode == 0
    assert list((tmp_path / "data" / "state").rglob("*.npz"))
    # An entity or a database that is not there at the next start takes nothing away.
    del house.states["climate.living"]
    (tmp_path / "home-assistant_v2.db").unlink()
    with Addon(tmp_path, house, rooms[:1], *quick) as running:
        running.says("room living: Home Assistant has no entity 'climate.living'.*; it stays as it was")
        running.says("the recorder has no database home-assistant_v2.db")
        running.says("serving on")
        running.says("entity 'climate.living' has no value")


def test_what_is_missing_is_said_before_anything_is_changed(tmp_path: Path, house: House) -> None:
    with Addon(tmp_path, house, []) as running:
        assert running.process.wait(PATIENCE) == 1
        assert "the Supervisor knows no MQTT broker" in running.log()
    house.mqtt = {"host": "127.0.0.1", "port": 1, "ssl": False}
    for rooms, sentence in (([], "enter outdoor temperature and rooms"), ([ATTIC], "no room can be run")):
        with Addon(tmp_path, house, rooms) as running:
            assert running.process.wait(PATIENCE) == 1
            assert sentence in running.log()
            assert "Traceback" not in running.log()
    assert not (tmp_path / "data" / "thermogate.toml").exists()


def test_a_wrong_password_is_said_and_ends_nothing(tmp_path: Path, house: House, site: Mosquitto) -> None:
    house.mqtt["password"] = "wrong"
    with Addon(tmp_path, house, [{"name": "living", "thermostat": "climate.living"}]) as running:
        running.says(r"sources\.home: .* refuses this client \(Not authorized\); check user and password")
        running.says("serving on")
    assert running.process.returncode == 0
