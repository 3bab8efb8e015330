"""The walkthrough of docs/home-assistant.md with Home Assistant itself: telemetry from it, and every zone in it."""

import asyncio
import json
import re
import subprocess
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
import yaml
from support import sites
from support.broker import Party, broker
from support.fake_zones import doubted, make_update, running, skill_over
from support.harness import EXAMPLES, ROOT, Daemon
from support.home_assistant import HomeAssistant
from support.processes import program
from support.running_zone import Announced

from adapters.mqtt.broker import BrokerConfig
from estimator.diagnosis.finding import Finding
from replay.recorded.learning import learn
from service.config.load import load_history
from service.errors import ConfigError
from service.forecast.ahead import LookingAhead
from service.forecast.answers import Preheat, Range
from service.publish.mqtt import Publisher
from service.publish.sinks import Announcement, Occasion, Reports
from service.recordings.history import survey
from service.records.skill import HorizonSkill
from service.records.trust import HorizonTrust, Trust
from service.records.update import Disturbance

PAGE = (ROOT / "docs" / "home-assistant.md").read_text(encoding="utf-8")
FORECAST = "sensor.thermogate_living_forecast"
NOISE = ((0.04, 0.05, 0.06),)
BEATEN = "1 h ahead, no change is better"
STUCK = "T_air has told the same to the last digit for longer than ever; check sensor"

HOUSE = Path(__file__).with_name("house.yaml").read_text(encoding="utf-8")


def block(mark: str) -> str:
    """The YAML that follows the comment `mark` on the page."""
    found = re.search(rf"<!-- {re.escape(mark)} -->\n```yaml\n(.*?)```", PAGE, re.DOTALL)
    assert found, mark
    return found[1]


def automations() -> str:
    """The automations of the page; the one that publishes does so every second."""
    telemetry, window = (yaml.safe_load(block(mark)) for mark in ("automation", "automation: window"))
    assert telemetry["trigger"] == [{"platform": "time_pattern", "minutes": "/1"}]
    telemetry["trigger"] = [{"platform": "time_pattern", "seconds": "/1"}]
    return yaml.safe_dump({"automation": [telemetry, window]})


def entities(document: Any) -> set[str]:
    """Every id of an entity of ours in a card and the cards within."""
    if isinstance(document, dict):
        return set().union(*map(entities, document.values()))
    if isinstance(document, list):
        return set().union(*map(entities, document))
    return set(re.findall(r"(?:binary_)?sensor\.thermogate_\w+", document)) if isinstance(document, str) else set()


def documented(zone: str = "living") -> set[str]:
    """The entities that the table names in full, of this zone."""
    table = PAGE.partition("## What appears")[2].partition("\n## ")[0]
    return {name.replace("<zone>", zone) for name in re.findall(r"`((?:binary_)?sensor\.[^`]*[^.`])`", table)}


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[HomeAssistant, int, Path]]:
    """Home Assistant with the page's automations, the port of its broker, and the folder of its configuration."""
    folder = tmp_path_factory.mktemp("home")
    settings = f"{HOUSE}{automations()}recorder:\n  commit_interval: 1\n"
    with broker(folder) as site, HomeAssistant(folder / "house", settings) as house:
        house.set_up(site.port)
        yield house, site.port, folder / "house"


def ours(house: HomeAssistant, zone: str = "") -> dict[str, Any]:
    return {name: entity for name, entity in house.states().items() if f".thermogate_{zone}" in name}


def unavailable(house: HomeAssistant) -> bool:
    states = [entity["state"] for entity in ours(house).values()]
    return len(states) > 10 and set(states) == {"unavailable"}


def problem(house: HomeAssistant) -> dict[str, Any]:
    """What the entity that says what is wrong says."""
    attributes = house.states()["binary_sensor.thermogate_living_problem"]["attributes"]
    assert attributes["device_class"] == "problem"
    return {name: attributes[name] for name in ("sentence", "all")}


def generated(body: str, attributes: dict[str, Any]) -> Any:
    """The points that a generator of an ApexCharts card draws, whose body is JavaScript over an `entity`."""
    entity = json.dumps({"attributes": attributes})
    script = f"process.stdout.write(JSON.stringify(new Function('entity', {json.dumps(body)})({entity})))"
    command = [program("node", "nodejs"), "-e", script]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def announced(name: str) -> Announcement:
    """Everything that a zone can say, with a finding that can be mended."""
    zone, update = doubted(name), make_update(3)._replace(disturbance=Disturbance((-900.0, -600.0, -350.0), 0.9, NOISE))
    stuck = Finding("sensor-stuck", "T_air", STUCK)
    zone.diagnosis = zone.diagnosis._replace(findings=(*zone.diagnosis.findings, stuck))
    leads, rest = (300, 3600, 21600, 86400), (12, 0.95, 0.03)
    horizons = tuple(HorizonSkill.of(lead, *rest, 0.05 * lead / 300, 0.2, lead / 1000, 0.06) for lead in leads)
    skill = skill_over(update.time, dict.fromkeys((1, 7, 30), horizons))
    by, some = update.forecast.issue_time + 7200.0, Range(20.6, 20.1, 21.2)
    zone.updates.append(update)
    told = tuple(HorizonTrust(lead, "learning", "wait", update.time) for lead in leads)
    zone.trusted = Trust(update.time, told, beaten=BEATEN)
    zone.heating = Preheat(by - 7200.0, "trusted", 21.0, by, 0.5, 0.9, by - 3600.0, 60.0, 0.93, some, some, 17.0)
    heard = Announced()
    asyncio.run(LookingAhead("home", {name: zone}, [heard]).attend(name))
    reports = Reports(skill, trust=zone.now().trust, ahead=heard.told[0].reports.ahead)
    return Announcement("home", name, zone.now()._replace(update=update), Occasion.UPDATE, reports)


def test_ids_are_as_documented_where_names_are_german(home: tuple[HomeAssistant, int, Path]) -> None:
    house, port, _ = home
    client = BrokerConfig(host="127.0.0.1", port=port, client_id="thermogate-german")
    publisher = Publisher(client, "home", "homeassistant", language="de").open()
    publisher.add("attic")
    publisher.publish(announced("attic"))
    house.until(lambda: documented("attic") <= house.states().keys())
    assert house.render("{{ state_attr('sensor.thermogate_attic_forecast', 'friendly_name') }}").endswith("Vorhersage")
    publisher.remove("attic")
    house.until(lambda: not ours(house, "attic"))
    publisher.close()


def test_every_value_is_as_published(home: tuple[HomeAssistant, int, Path]) -> None:
    house, port, _ = home
    client = BrokerConfig(host="127.0.0.1", port=port, client_id="thermogate-home")
    publisher = Publisher(client, "home", "homeassistant", "http://127.0.0.1:8080/").open()
    publisher.add("living")
    told = announced("living")
    publisher.publish(told)
    update, ahead, hour = told.update, told.reports.ahead, told.reports.skill.over(7)[1]
    house.until(lambda: float(house.state(FORECAST)))
    house.until(lambda: float(house.state("sensor.thermogate_living_skill_1h_ahead")))
    house.until(lambda: float(house.state("sensor.thermogate_living_learning_gate")))
    house.until(lambda: house.state("sensor.thermogate_living_trust_1d_ahead") == "learning")
    house.until(lambda: house.state("binary_sensor.thermogate_living_problem") == "on")
    shown = {name: one["state"] for name, one in ours(house).items()}
    (output,) = update.forecast.outputs
    numbers = {
        FORECAST: output.mean,
        f"{FORECAST}_lower_95": output.intervals[0].lower,
        f"{FORECAST}_upper_95": output.intervals[0].upper,
        **{
            f"{FORECAST}_{lead}_ahead": one.mean
            for lead, one in zip(("1h", "6h", "1d"), ahead.outputs[0].horizons, strict=True)
        },
        "sensor.thermogate_living_volatility": update.volatility.median[0],
        "sensor.thermogate_living_learning_gate": update.gate.value,
        "sensor.thermogate_living_skill_1h_ahead": hour.skill_against_persistence,
        "sensor.thermogate_living_error_1h_ahead": hour.rmse,
    }
    assert {name: float(shown[name]) for name in numbers} == pytest.approx(numbers, abs=1e-12)
    assert shown["sensor.thermogate_living_regime"] == update.gate.regime
    assert shown["sensor.thermogate_living_state"] == "running"
    assert documented() <= shown.keys()
    lost = house.states()["sensor.thermogate_living_unmeasured_heat"]
    assert (float(lost["state"]), lost["attributes"]["lower"], lost["attributes"]["upper"]) == (-600.0, -900.0, -350.0)
    assert {name for name, state in shown.items() if state == "on"} == {"binary_sensor.thermogate_living_problem"}
    assert problem(house) == {"sentence": STUCK, "all": [STUCK]}, "the others are for experts"
    trust = house.states()["sensor.thermogate_living_trust_1d_ahead"]["attributes"]
    assert (trust["reason"], trust["planned"], trust["beaten"]) == ("wait", "learning", BEATEN)
    start = house.states()["sensor.thermogate_living_start_heating"]
    assert datetime.fromisoformat(start["state"]).timestamp() == ahead.heating.start
    assert (start["attributes"]["target"], start["attributes"]["reached"]) == (21.0, 0.93)
    url = house.render("{{ device_attr(device_id('" + FORECAST + "'), 'configuration_url') }}")
    assert url == "http://127.0.0.1:8080/#/zone/living"
    drawn = house.states()[f"{FORECAST}_1d_ahead"]["attributes"]
    assert drawn["upper"] == pytest.approx(ahead.outputs[0].horizons[-1].upper)
    for series, name in zip(yaml.safe_load(block("apexcharts"))["series"][1:], ("mean", "lower", "upper"), strict=True):
        assert series["entity"] in shown
        points = [
            [1000 * (ahead.valid_time + 1800 * k), round(value, 2)]
            for k, value in enumerate(getattr(ahead.outputs[0], name).tolist())
        ]
        assert generated(series["data_generator"], drawn) == points
    stalled = running("living")
    stalled.state, stalled.reason = "stalled", "no measurement of T_i for 13 steps of 300 s"
    publisher.publish(Announcement("home", "living", stalled.now()._replace(update=update), Occasion.STATUS))
    house.until(lambda: house.state(FORECAST) == "unavailable")
    assert house.state(f"{FORECAST}_6h_ahead") == "unavailable"
    assert house.state("binary_sensor.thermogate_living_problem") == "on"
    assert problem(house)["sentence"] == stalled.reason
    state = house.states()["sensor.thermogate_living_state"]
    assert (state["state"], state["attributes"]["reason"]) == ("stalled", stalled.reason)
    publisher.remove("living")
    house.until(lambda: not ours(house))
    publisher.close()
    # Home Assistant says here what it does not like about an entity.
    lines = [line for line in house.log().splitlines() if "mqtt" in line.lower() and "ERROR" in line]
    # The automation began before there was a broker.
    assert [line for line in lines if "mqtt.publish not found" not in line] == []


def test_the_walkthrough(home: tuple[HomeAssistant, int, Path], tmp_path: Path) -> None:
    """From an automation of Home Assistant through the daemon to a device there."""
    house, port, _ = home
    place = {"host": "127.0.0.1", "port": port, "password_env": "HOME"}
    settings: dict[str, object] = {
        "site.state_dir": str(tmp_path / "state"),
        "zones.0.period": "2s",
        "zones.0.estimator_options.particles": 100,
        **{f"mqtt.{key}": value for key, value in place.items()},
        **{f"sources.home.{key}": value for key, value in place.items()},
    }
    with (
        Party(port, "thermogate/home/living/forecast") as listening,
        Daemon(EXAMPLES / "home-assistant.toml", tmp_path / "log", settings) as daemon,
    ):
        daemon.wait(lambda zones: zones["living"]["samples"] >= 3)
        house.until(lambda: 10 < float(house.state(FORECAST)) < 30)
        house.until(lambda: _as_published(house, listening))
        status, zone = daemon.get("/zones/living")
        assert status == 200
        assert {one["channel"] for one in zone["status"]["channels"] if one["last_good"]} == {"T_i", "T_out", "u_heat"}
        assert zone["status"]["faults"].keys() <= {"out_of_order"}
        # The thermostat heats, since its room is colder than it should be.
        inputs = {one["channel"]: one["value"] for one in daemon.get("/zones/living/forecast")[1]["inputs"]}
        assert inputs == {"T_out": 4.0, "u_heat": 1500.0}
        house.until(lambda: house.state("sensor.thermogate_living_state") == "running")
        house.until(lambda: 0 < float(house.state(f"{FORECAST}_1h_ahead")) < 40)
        # Six hours are more steps of 2 s than are forecast at once.
        missing = entities(yaml.safe_load(block("dashboard"))) - house.states().keys()
        assert missing == {f"{FORECAST}_6h_ahead"}
        assert house.render("{{ device_attr('" + FORECAST + "', 'name') }}") == "Thermogate living"
        daemon.kill()
        house.until(lambda: unavailable(house))
    with Daemon(EXAMPLES / "home-assistant.toml", tmp_path / "log", settings) as daemon:
        house.until(lambda: house.state(FORECAST) not in ("unavailable", "unknown"))
        assert daemon.terminate() == 0
        house.until(lambda: unavailable(house))


def _as_published(house: HomeAssistant, listening: Party) -> bool:
    """Whether Home Assistant shows the forecast that was published last, which is a matter of the moment."""
    document = json.loads(listening.newest()["thermogate/home/living/forecast"])
    entity = house.states()[FORECAST]
    if entity["attributes"]["issue_time"] != document["issue_time"]:
        return False
    assert float(entity["state"]) == document["mean"]
    assert entity["attributes"]["unit_of_measurement"] == "°C"
    assert entity["attributes"]["quality"] == document["quality"]
    return True


def test_a_zone_learns_from_what_the_recorder_has_kept(home: tuple[HomeAssistant, int, Path], tmp_path: Path) -> None:
    """Home Assistant writes the database, and `thermogate learn` takes it into the state of a live zone."""
    house, _, folder = home
    for step in range(8):
        degrees = {"unit_of_measurement": "°C", "device_class": "temperature"}
        told = {"sensor.outdoor": ("4.0", degrees), "sensor.study": (f"{20 + 0.1 * step:.1f}", degrees)}
        told["climate.study"] = ("heat", {"hvac_action": "heating" if step % 2 else "idle"})
        for entity, (state, attributes) in told.items():
            house.ask(f"/api/states/{entity}", {"state": state, "attributes": attributes})
        time.sleep(1.0)
    places = {name: {"topic": name} for name in sites.UNITS}
    zone = sites.zone("room", "home", places, network="titeth", estimator="ekf")
    plant = sites.written(tmp_path, {"home": {"kind": "mqtt", "host": "127.0.0.1"}}, [zone])
    history = Path(__file__).with_name("recorder.toml").read_text(encoding="utf-8").replace("FOLDER", str(folder))
    (tmp_path / "history.toml").write_text(history)
    config = load_history(plant, tmp_path / "history.toml")
    (trace,) = learn(config, survey(config, config.zones, None, None), jobs=1).traces
    measured = [row.y for row in trace.rows if row.y == row.y]
    assert len(measured) >= 4
    assert measured == sorted(measured)
    assert 20.0 <= measured[0] < measured[-1] <= 21.1
    wrong = history.replace('entity = "sensor.study", unit = "degC"', 'entity = "sensor.study", unit = "degF"')
    (tmp_path / "history.toml").write_text(wrong)
    with pytest.raises(ConfigError, match=r"'sensor\.study' is in °C"):
        load_history(plant, tmp_path / "history.toml")
