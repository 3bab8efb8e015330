"""The integration inside Home Assistant, against the daemon of test_home_assistant.py, whose environment runs this."""

import asyncio
import json
import os
import re
import subprocess
from collections.abc import AsyncIterator, Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from custom_components.thermogate import async_remove_config_entry_device
from custom_components.thermogate.client import Client, DaemonError, KeyRefused, Unreachable
from custom_components.thermogate.coordinator import Coordinator, client_of
from custom_components.thermogate.diagnostics import async_get_config_entry_diagnostics
from custom_components.thermogate.room import Room
from homeassistant.config_entries import SOURCE_USER, ConfigEntryState
from homeassistant.core import HomeAssistant
from homeassistant.data_entry_flow import FlowResultType
from homeassistant.exceptions import ServiceValidationError
from homeassistant.helpers import device_registry, entity_registry, issue_registry
from homeassistant.setup import async_setup_component
from homeassistant.util import dt
from homeassistant.util.unit_conversion import PowerConverter
from homeassistant.util.unit_system import METRIC_SYSTEM, US_CUSTOMARY_SYSTEM
from pytest_homeassistant_custom_component.common import MockConfigEntry, async_fire_time_changed

SITE = json.loads(os.environ["THERMOGATE_SITE"])
"""url, keys (admin, reader, short: the last one to be revoked), file (the configuration), command."""

DOMAIN = "thermogate"
ROOM = {"climate": "climate.living", "outdoor": "sensor.outdoor", "power": 6000, "zone": "living"}
DAEMON = {"url": SITE["url"], "api_key": SITE["admin"], "verify_ssl": True}
GONE = "http://127.0.0.1:9"


@pytest.fixture(autouse=True)
def _real(enable_custom_integrations: None, socket_enabled: None) -> None:
    """The integration is found, and may talk to the daemon."""


@pytest.fixture(autouse=True)
def _house(hass: HomeAssistant) -> None:
    hass.config.units = METRIC_SYSTEM
    hass.states.async_set(
        "climate.living", "heat", {"current_temperature": 20.5, "temperature": 21, "hvac_action": "idle"}
    )
    hass.states.async_set("climate.broken", "heat", {"current_temperature": None, "hvac_action": "idle"})
    hass.states.async_set("sensor.outdoor", "4.0", {"unit_of_measurement": "°C"})
    hass.states.async_set("sensor.humidity", "40", {"unit_of_measurement": "g/m³"})
    hass.states.async_set("sensor.valve", "25", {"unit_of_measurement": "%"})


@pytest.fixture(autouse=True)
async def _unloaded(hass: HomeAssistant) -> AsyncIterator[None]:
    yield
    for entry in hass.config_entries.async_entries(DOMAIN):
        if entry.state is ConfigEntryState.LOADED:
            await hass.config_entries.async_unload(entry.entry_id)


async def until(hass: HomeAssistant, found: Callable[[], Any]) -> Any:
    """What `found` returns, as soon as that is true."""
    async with asyncio.timeout(120):
        while not (result := found()):
            await asyncio.sleep(0.02)
            await hass.async_block_till_done()
        return result


def state(hass: HomeAssistant, sensor: str) -> str:
    """The state of a sensor of the room "living"; "gone" as long as there is none."""
    found = hass.states.get(f"sensor.thermogate_living_{sensor}")
    return "gone" if found is None else found.state


def known(hass: HomeAssistant, sensor: str) -> bool:
    return state(hass, sensor) not in ("gone", "unknown", "unavailable")


async def told(hass: HomeAssistant, shown: dict[str, Any], data: dict[str, Any]) -> dict[str, Any]:
    """What follows a form that is filled in."""
    return await hass.config_entries.flow.async_configure(shown["flow_id"], data)


async def begin(hass: HomeAssistant, room: dict[str, Any] = ROOM) -> dict[str, Any]:
    """The flow up to the form of the daemon."""
    flow = await hass.config_entries.flow.async_init(DOMAIN, context={"source": SOURCE_USER})
    assert (flow["type"], flow["step_id"]) == (FlowResultType.FORM, "user")
    return await told(hass, flow, room)


async def connected(hass: HomeAssistant, data: dict[str, Any] = DAEMON, **room: Any) -> MockConfigEntry:
    """A config entry that is set up, with its zone heard."""
    stored = {"climate": "climate.living", "heating": None, "outdoor": "sensor.outdoor", "power": 6000.0} | room
    rooms = {"living": {"zone": "living", **stored}}
    entry = MockConfigEntry(domain=DOMAIN, title="home", unique_id="home", data=data, options={"rooms": rooms})
    entry.add_to_hass(hass)
    await hass.config_entries.async_setup(entry.entry_id)
    if entry.state is ConfigEntryState.LOADED:
        await until(hass, lambda: state(hass, "state") == "running")
    return entry


def coordinator(hass: HomeAssistant, entry: MockConfigEntry) -> Coordinator:
    """What is behind a config entry that is set up."""
    assert entry.state is ConfigEntryState.LOADED
    return hass.data[DOMAIN][entry.entry_id]


def rooms(hass: HomeAssistant, entry: MockConfigEntry) -> dict[str, Room]:
    """The rooms of a config entry, which are none while it is set up anew."""
    return coordinator(hass, entry).rooms if entry.state is ConfigEntryState.LOADED else {}


def issues(hass: HomeAssistant) -> dict[str, str | None]:
    """The key of every issue by its id."""
    return {
        name: one.translation_key for (of, name), one in issue_registry.async_get(hass).issues.items() if of == DOMAIN
    }


@pytest.mark.parametrize(
    ("wrong", "errors"),
    [
        ({"climate": "climate.broken"}, {"climate": "no_temperature"}),
        ({"heating": "sensor.humidity"}, {"heating": "no_heating"}),
        ({"outdoor": "sensor.humidity"}, {"outdoor": "no_outdoor"}),
        ({"zone": "Living Room"}, {"zone": "zone_name"}),
    ],
)
async def test_a_room_that_cannot_be_measured(hass: HomeAssistant, wrong: dict, errors: dict[str, str]) -> None:
    shown = await begin(hass, ROOM | wrong)
    assert (shown["step_id"], shown["errors"]) == ("user", errors)
    again = await told(hass, shown, ROOM)
    assert again["step_id"] == "daemon", "nothing that was entered is lost"


async def test_without_an_outdoor_sensor_the_weather_counts(hass: HomeAssistant) -> None:
    room = {name: value for name, value in ROOM.items() if name != "outdoor"}
    assert (await begin(hass, room))["errors"] == {"outdoor": "no_outdoor"}
    hass.states.async_set("weather.home", "sunny", {"temperature": 50.0, "temperature_unit": "°F"})
    history = (await begin(hass, room))["description_placeholders"]["history"]
    assert 'T_out = { source = "past", entity = "weather.home", attribute = "temperature", unit = "degF" }' in history


async def test_a_daemon_that_does_not_do(hass: HomeAssistant, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each mistake is named, and the form stays."""
    shown = await begin(hass)
    for wrong, error, problem in (
        ({"url": GONE}, "cannot_connect", "no Thermogate daemon answers at http://127.0.0.1:9"),
        ({"api_key": "tg_wrong"}, "invalid_auth", "key"),
        ({"api_key": SITE["reader"]}, "invalid_auth", "this needs an API key for write"),
    ):
        shown = await told(hass, shown, DAEMON | wrong)
        assert shown["errors"] == {"base": error}
        assert problem in shown["description_placeholders"]["problem"]
    with monkeypatch.context() as lost:
        ask = Client.ask

        async def posts_only(client: Client, method: str, path: str, *more: Any, **named: Any) -> Any:
            if method == "GET":
                raise Unreachable("it has just gone")
            return await ask(client, method, path, *more, **named)

        lost.setattr(Client, "ask", posts_only)
        shown = await told(hass, shown, DAEMON)
        assert shown["errors"] == {"base": "cannot_connect"}
    done = await told(hass, shown, DAEMON)
    assert (done["type"], done["title"]) == (FlowResultType.CREATE_ENTRY, "home")
    assert done["options"]["rooms"]["living"]["climate"] == "climate.living"


async def test_a_zone_is_pasted_and_the_daemon_takes_it(hass: HomeAssistant) -> None:
    shown = await begin(hass, ROOM | {"zone": "attic", "heating": "sensor.valve", "power": 800})
    shown = await told(hass, shown, DAEMON)
    assert shown["errors"] == {"base": "zone_unknown"}
    assert shown["description_placeholders"]["problem"] == "attic/T_i, attic/T_out, attic/u_heat"
    file, text = Path(SITE["file"]), shown["description_placeholders"]["toml"]
    before, zone = file.read_text(), text[text.index("[[zones]]") :]
    file.write_text(before + zone.replace('"degC"', '"banana"', 1))
    shown = await told(hass, shown, DAEMON)
    assert shown["errors"] == {"base": "reload_refused"}
    assert "banana" in shown["description_placeholders"]["problem"]
    file.write_text(before + zone)
    done = await told(hass, shown, DAEMON)
    assert done["type"] == FlowResultType.CREATE_ENTRY
    (entry,) = hass.config_entries.async_entries(DOMAIN)
    assert coordinator(hass, entry).taken["accepted"] == 4, "with the set-point"
    # What the form gives to begin with is a whole configuration, and so is the one of the history.
    (file.parent / "whole.toml").write_text(text)
    (file.parent / "history.toml").write_text(shown["description_placeholders"]["history"])
    # A second room of the same daemon joins its entry, where the first one is kept.
    joined = await begin(hass)
    joined = await told(hass, joined, DAEMON)
    assert (joined["type"], joined["reason"]) == (FlowResultType.ABORT, "room_added")
    assert entry.options["rooms"].keys() == {"attic", "living"}
    await until(hass, lambda: known(hass, "state"))
    # A room whose device is deleted is given up.
    device = device_registry.async_get(hass).async_get_device({(DOMAIN, "home/attic")})
    assert await async_remove_config_entry_device(hass, entry, device)
    await hass.async_block_till_done()
    assert entry.options["rooms"].keys() == {"living"}
    await until(hass, lambda: rooms(hass, entry).keys() == {"living"} and known(hass, "state"))


async def test_sentences_are_in_the_language_of_home_assistant(hass: HomeAssistant) -> None:
    await connected(hass)
    hass.config.language = "de"
    german = client_of(hass, DAEMON)
    room = await german.ask("GET", "/zones/living/room", params=german.spoken)
    assert "h zu kalt und" in room["answers"][0]["sentence"]
    async with asyncio.timeout(60):
        streamed = await anext(document async for topic, document in german.events("living") if topic == "trust")
    assert " ahead" not in json.dumps(streamed)


async def test_a_room_with_forecasts(hass: HomeAssistant) -> None:
    """Devices, sensors, services and diagnostics, with what the daemon says at the same time."""
    entry = await connected(hass)
    client = coordinator(hass, entry).client
    name = "sensor.thermogate_living"
    await until(hass, lambda: known(hass, "forecast_1d_ahead"))
    fan = (await client.ask("GET", "/zones/living/forecast", params={"horizon": "1430min"}))["fan"]
    shown = hass.states.get(f"{name}_forecast_1d_ahead")
    assert float(shown.state) == pytest.approx(fan[-1]["outputs"][0]["mean"], abs=0.2)
    assert shown.attributes["unit_of_measurement"] == "°C"
    assert shown.attributes["lower"] < float(shown.state) < shown.attributes["upper"]
    assert len(shown.attributes["fan"]["mean"]) == 48
    trust = {one["lead_s"]: one["trust"] for one in (await client.ask("GET", "/zones/living/trust"))["horizons"]}
    for hour, lead in {"1h": 3600, "6h": 21600, "1d": 86400}.items():
        assert state(hass, f"trust_{hour}_ahead") == trust[lead] != "learning"
    assert state(hass, "quality") == "good"
    # The recording ends in a set-back.
    start = hass.states.get(f"{name}_start_heating")
    assert dt.parse_datetime(start.state) < dt.parse_datetime(start.attributes["by"])
    assert start.attributes["target"] == pytest.approx(21.0, abs=0.1)
    room = await client.ask("GET", "/zones/living/room")
    assert hass.states.get(f"{name}_advice").attributes["to_do"] == room["to_do"]
    registry = entity_registry.async_get(hass)
    ours = entity_registry.async_entries_for_config_entry(registry, entry.entry_id)
    assert len(ours) == 11
    assert len({one.device_id for one in ours}) == 1
    device = device_registry.async_get(hass).async_get(ours[0].device_id)
    assert (device.name, device.configuration_url) == ("Thermogate living", f"{SITE['url']}/#/zone/living")

    async def ask(service: str, **data: Any) -> Any:
        return await hass.services.async_call(
            DOMAIN, service, {"device_id": device.id, **data}, blocking=True, return_response=True
        )

    forecast = (await ask("forecast", horizon=2, setpoint=23))["forecast"]
    assert len(forecast) == 13
    assert forecast[-1]["lower"] < forecast[-1]["mean"] < forecast[-1]["upper"]
    assert forecast[-1]["mean"] > (await ask("forecast", horizon=2, setpoint=16))["forecast"][-1]["mean"]
    # Home Assistant's clock counts, which the daemon does not know.
    assert dt.now().utcoffset()
    by = (dt.now() + timedelta(hours=8)).replace(second=0, microsecond=0)
    early = await ask("preheat", target=22, by=by.strftime("%H:%M"))
    assert (early["target"], dt.parse_datetime(early["by"])) == (22, by)
    assert early["energy"]["mean"] > 0
    cheaper = await ask("what_if", setpoints=[22, 18], horizon=6, price=0.3)
    (difference,) = cheaper["differences"]
    assert all(difference[name]["mean"] < difference[name]["upper"] < 0 for name in ("energy", "cost"))
    assert difference["hours_below"]["mean"] > 0
    demand = await ask("demand", horizon=6, setpoint=22)
    assert demand["total"] == pytest.approx(cheaper["plans"][0]["energy"])
    assert sum(hour["energy"]["mean"] for hour in demand["hours"]) == pytest.approx(demand["total"]["mean"])
    assert not (await ask("demand"))["planned"]
    with pytest.raises(ServiceValidationError, match="target"):
        await ask("preheat", target=80, by="07:00")
    with pytest.raises(ServiceValidationError, match="no room"):
        await hass.services.async_call(DOMAIN, "forecast", {"device_id": "x"}, blocking=True, return_response=True)
    # In Fahrenheit the same question has the same answer.
    hass.config.units = US_CUSTOMARY_SYSTEM
    warm = (await ask("forecast", horizon=2, setpoint=73.4))["forecast"]
    assert warm[-1]["mean"] == pytest.approx(forecast[-1]["mean"] * 1.8 + 32, abs=1e-6)
    told = await async_get_config_entry_diagnostics(hass, entry)
    assert SITE["admin"] not in json.dumps(told)
    assert told["values"]["living"]["T_out"] == 4.0
    assert told["connected"] is True
    assert await hass.config_entries.async_unload(entry.entry_id)
    assert state(hass, "state") == "unavailable"


async def test_fahrenheit(hass: HomeAssistant) -> None:
    hass.config.units = US_CUSTOMARY_SYSTEM
    hass.states.async_set(
        "climate.living", "heat", {"current_temperature": 68.0, "temperature": 70.7, "hvac_action": "heating"}
    )
    hass.states.async_set("sensor.outdoor", "41", {"unit_of_measurement": "°F"})
    room = coordinator(hass, await connected(hass)).rooms["living"]
    assert room.values(hass) == pytest.approx({"T_i": 20.0, "setpoint": 21.5, "T_out": 5.0, "u_heat": 6000.0})
    assert room.history(hass).count('"degF"') == 3
    await until(hass, lambda: known(hass, "forecast_1h_ahead"))
    shown = hass.states.get("sensor.thermogate_living_forecast_1h_ahead")
    assert shown.attributes["unit_of_measurement"] == "°F"
    assert 50 < shown.attributes["lower"] < float(shown.state) < 90


@pytest.mark.parametrize(
    ("heating", "state", "attributes", "watts"),
    [
        (None, "", {}, 0.0),
        ("sensor.power", "1.2", {"unit_of_measurement": "kW"}, 1200.0),
        ("sensor.valve", "25", {"unit_of_measurement": "%"}, 1500.0),
        ("switch.heater", "on", {}, 6000.0),
        ("switch.heater", "unavailable", {}, None),
        ("sensor.power", "unknown", {"unit_of_measurement": "W"}, None),
    ],
)
async def test_the_heat(
    hass: HomeAssistant, heating: str | None, state: str, attributes: dict, watts: float | None
) -> None:
    if heating:
        hass.states.async_set(heating, state, attributes)
    assert Room("living", "climate.living", heating, 6000.0).values(hass).get("u_heat") == watts


@pytest.mark.parametrize(("unit", "known"), [("MW", True), ("mW", False)])
def test_units_of_newer_releases(hass: HomeAssistant, monkeypatch: pytest.MonkeyPatch, unit: str, known: bool) -> None:
    more = dict.fromkeys(("MW", "mW"), 1.0)
    monkeypatch.setattr(PowerConverter, "VALID_UNITS", {*PowerConverter.VALID_UNITS, *more})
    monkeypatch.setattr(PowerConverter, "_UNIT_CONVERSION", PowerConverter._UNIT_CONVERSION | more)
    hass.states.async_set("sensor.power", "1.2", {"unit_of_measurement": unit})
    room = Room("living", "climate.living", "sensor.power", 6000.0, "sensor.outdoor")
    assert ("u_heat" in room.values(hass)) == known
    assert ('unit = "MW"' in room.history(hass)) == known


async def test_a_thermostat_that_defrosts_does_not_heat(hass: HomeAssistant) -> None:
    hass.states.async_set("climate.living", "heat", {"current_temperature": 20.5, "hvac_action": "defrosting"})
    assert Room("living", "climate.living", None, 6000.0).values(hass)["u_heat"] == 0.0


async def test_findings_and_what_is_gone_are_issues(hass: HomeAssistant) -> None:
    await async_setup_component(hass, "repairs", {})
    entry = await connected(hass)
    here = coordinator(hass, entry)
    here.data["living"]["status"]["findings"] = [
        {"finding": "sensor-stuck", "subject": "T_i", "sentence": "Look at it"}
    ]
    hass.states.async_remove("sensor.outdoor")
    here.report()
    assert set(issues(hass).values()) >= {"finding", "entity_missing"}
    taken = {one["channel"] for one in here.rooms["living"].readings(hass, dt.utcnow())}
    assert taken == {"living/T_i", "living/setpoint", "living/u_heat"}, "the others go on"
    here.data["living"]["status"]["findings"] = []
    hass.states.async_set("sensor.outdoor", "4.0", {"unit_of_measurement": "°C"})
    here.report()
    assert "entity_missing" not in issues(hass).values()
    here.taken = {"unknown": 1, "unknown_names": ["living/setpoint"]}
    here.report()
    assert issues(hass) == {}, "a zone need not have a set-point"
    here.taken = {"unknown": 1, "unknown_names": ["living/T_i"]}
    here.report()
    assert issues(hass) == {"home unknown": "not_taken"}
    await hass.config_entries.async_unload(entry.entry_id)
    assert issues(hass) == {}


async def test_an_outage_is_logged_once_and_passes(hass: HomeAssistant, caplog: pytest.LogCaptureFixture) -> None:
    entry = await connected(hass)
    here = coordinator(hass, entry)
    url, here.client.url = here.client.url, GONE
    for _ in range(4):
        await here.async_refresh()
    assert state(hass, "state") == "unavailable"
    errors = [record.getMessage() for record in caplog.records if record.levelname == "ERROR"]
    assert len(errors) == 1
    assert "no Thermogate daemon answers" in errors[0]
    here.client.url = url
    await here.async_refresh()
    assert state(hass, "state") == "running"
    assert here.taken["accepted"] == 12, "the last three posts"


async def test_a_revoked_key_is_asked_for_again(hass: HomeAssistant) -> None:
    entry = await connected(hass, DAEMON | {"api_key": SITE["short"]})
    await asyncio.to_thread(subprocess.run, [*SITE["command"], "keys", "revoke", SITE["file"], "short"], check=True)

    # The next post is due, and the daemon follows the file of keys.
    while not hass.config_entries.flow.async_progress():
        async_fire_time_changed(hass, dt.utcnow() + timedelta(seconds=61))
        await hass.async_block_till_done()
        await asyncio.sleep(0.05)
    (flow,) = hass.config_entries.flow.async_progress()
    assert (flow["context"]["source"], flow["step_id"]) == ("reauth", "reconnect")
    shown = await told(hass, flow, DAEMON | {"api_key": SITE["short"]})
    assert shown["errors"] == {"base": "invalid_auth"}
    done = await told(hass, flow, DAEMON)
    assert done["reason"] == "reauth_successful"
    await until(hass, lambda: state(hass, "state") == "running")
    assert entry.options["rooms"].keys() == {"living"}


async def test_the_daemon_has_moved(hass: HomeAssistant) -> None:
    """Another address for the same site; another site, and what refuses, are no such address."""
    entry = await connected(hass, DAEMON | {"url": GONE})
    assert entry.state is ConfigEntryState.SETUP_RETRY, "one that is away at the start is tried again"
    asked = {"source": "reconfigure", "entry_id": entry.entry_id}
    shown = await hass.config_entries.flow.async_init(DOMAIN, context=asked)
    assert shown["step_id"] == "reconnect"
    for url, error in ((GONE, "cannot_connect"), (SITE["url"] + "/page", "refused")):
        shown = await told(hass, shown, DAEMON | {"url": url})
        assert shown["errors"] == {"base": error}
    hass.config_entries.async_update_entry(entry, unique_id="elsewhere")
    shown = await told(hass, shown, DAEMON)
    assert shown["errors"] == {"base": "another_site"}
    hass.config_entries.async_update_entry(entry, unique_id="home")
    done = await told(hass, shown, DAEMON)
    assert done["reason"] == "reauth_successful"
    await until(hass, lambda: rooms(hass, entry) and known(hass, "state"))


async def test_what_the_daemon_cannot_use_is_refused(hass: HomeAssistant) -> None:
    """A zone that knows another unit is found before anything is set up; so is an address that is no daemon's."""
    file = Path(SITE["file"])
    shed = file.read_text()[file.read_text().index("[[zones]]") :].partition("[[zones]]\n")[2].partition("[[zones]]")[0]
    shed = "\n[[zones]]\n" + shed.replace('"living"', '"shed"').replace('unit = "W"', 'unit = "kW"')
    file.write_text(file.read_text() + shed)
    shown = await begin(hass, ROOM | {"zone": "shed"})
    shown = await told(hass, shown, DAEMON)
    assert shown["errors"] == {"base": "refused"}
    assert shown["description_placeholders"]["problem"] == "wrong_unit"
    shown = await told(hass, shown, DAEMON | {"url": SITE["url"] + "/page"})
    assert shown["errors"] == {"base": "refused"}


async def test_a_stream_whose_key_is_refused_ends(hass: HomeAssistant) -> None:
    """Trying again and again would make the daemon hold up the posts."""
    entry = await connected(hass)
    here = coordinator(hass, entry)
    here.client = client_of(hass, DAEMON | {"api_key": "tg_wrong"})
    await asyncio.wait_for(here.follow("living"), 30)
    (flow,) = hass.config_entries.flow.async_progress()
    assert flow["context"]["source"] == "reauth"
    assert state(hass, "state") == "unavailable"


async def test_another_entity_is_chosen_later(hass: HomeAssistant) -> None:
    entry = await connected(hass)
    shown = await hass.config_entries.options.async_init(entry.entry_id)
    shown = await hass.config_entries.options.async_configure(shown["flow_id"], {"room": "living"})
    assert shown["step_id"] == "room"
    changed = {"climate": "climate.living", "heating": "sensor.valve", "power": 500, "outdoor": "sensor.outdoor"}
    done = await hass.config_entries.options.async_configure(shown["flow_id"], changed)
    assert done["type"] == FlowResultType.CREATE_ENTRY
    assert entry.options["rooms"]["living"]["heating"] == "sensor.valve"
    await until(
        hass,
        lambda: (
            rooms(hass, entry).get("living") == Room("living", "climate.living", "sensor.valve", 500, "sensor.outdoor")
        ),
    )
    await until(hass, lambda: known(hass, "state"))
    assert (entry.data["api_key"], entry.options["rooms"].keys()) == (SITE["admin"], {"living"})
    shown = await hass.config_entries.options.async_init(entry.entry_id)
    shown = await hass.config_entries.options.async_configure(shown["flow_id"], {"room": "+"})
    shown = await hass.config_entries.options.async_configure(shown["flow_id"], ROOM | {"zone": "cellar"})
    assert (shown["step_id"], shown["errors"]) == ("zone", {})
    assert 'id = "cellar"' in shown["description_placeholders"]["toml"]
    shown = await hass.config_entries.options.async_configure(shown["flow_id"], {})
    assert shown["errors"] == {"base": "zone_unknown"}


@pytest.mark.parametrize("language", ["en", "de"])
def test_every_text_is_there(language: str) -> None:
    folder = Path(SITE["component"])
    texts, english = (json.loads((folder / "translations" / f"{one}.json").read_text()) for one in (language, "en"))

    def leaves(one: Any, place: str = "") -> dict[str, set[str]]:
        if isinstance(one, dict):
            return {k: v for name, inner in one.items() for k, v in leaves(inner, f"{place}.{name}").items()}
        return {place: set(re.findall(r"{\w+}", one))}

    assert leaves(texts) == leaves(english)
    flow = (folder / "config_flow.py").read_text()
    errors = set(re.findall(r'= "(no_\w+|zone_name)"', flow)) | set(re.findall(r'return "(\w+)", ', flow))
    errors |= {kind.form_error for kind in (DaemonError, KeyRefused, Unreachable)}
    assert errors <= texts["config"]["error"].keys()
    assert errors <= texts["options"]["error"].keys()
