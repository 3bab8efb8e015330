"""Questions to a zone: its forecast, when to start heating, the energy to come, and what other set-points change."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from datetime import time
from typing import Any

import voluptuous as vol
from homeassistant.const import UnitOfTemperature
from homeassistant.core import HomeAssistant, ServiceCall, SupportsResponse
from homeassistant.exceptions import HomeAssistantError, ServiceValidationError
from homeassistant.helpers import config_validation as cv
from homeassistant.helpers import device_registry
from homeassistant.util import dt as dt_util
from homeassistant.util.unit_conversion import TemperatureConverter

from .client import Client, DaemonError, Refused
from .coordinator import DOMAIN, Coordinator

_NUMBER = vol.Coerce(float)
_ROOM = {vol.Required("device_id"): cv.string}
_HORIZON = {vol.Optional("horizon", default=24): vol.All(vol.Coerce(int), vol.Range(1, 48))}
_SETPOINT = {vol.Optional("setpoint"): _NUMBER}

Answer = dict[str, Any]


class _Units:
    """Temperatures in the unit of Home Assistant."""

    def __init__(self, hass: HomeAssistant) -> None:
        self._own = hass.config.units.temperature_unit

    def asked(self, value: float) -> float:
        """In degC."""
        return TemperatureConverter.convert(value, self._own, UnitOfTemperature.CELSIUS)

    def told(self, value: float | None) -> float | None:
        """From degC; None stays."""
        return None if value is None else TemperatureConverter.convert(value, UnitOfTemperature.CELSIUS, self._own)


async def _forecast(client: Client, zone: str, given: Answer, units: _Units) -> Answer:
    path, horizon = f"/zones/{zone}/forecast", f"{given['horizon']}h"
    if "setpoint" in given:
        body = {"horizon": horizon, "levels": [0.95], "inputs": {"T_set": units.asked(given["setpoint"])}}
        found = await client.ask("POST", path, body)
    else:
        found = await client.ask("GET", path, params={"horizon": horizon, "level": "0.95"})

    def step(one: Answer) -> Answer:
        output = one["outputs"][0]
        (interval,) = output["intervals"]
        numbers = {"mean": output["mean"], "lower": interval["lower"], "upper": interval["upper"]}
        return {"time": one["valid_time"], **{name: units.told(value) for name, value in numbers.items()}}

    return {"quality": found["quality"], "forecast": [step(one) for one in found["fan"]]}


async def _preheat(client: Client, zone: str, given: Answer, units: _Units) -> Answer:
    by: time = given["by"]
    asked = {
        "target": units.asked(given["target"]),
        # A daemon may know no time zone, or another one.
        "by": dt_util.find_next_time_expression_time(dt_util.now(), [by.second], [by.minute], [by.hour]).isoformat(),
        "probability": given["probability"],
    }
    found = await client.ask("GET", f"/zones/{zone}/preheat", params=asked)
    told = {name: found[name] for name in ("trust", "by", "start", "minutes", "probability", "reached", "energy")}
    temperature = {name: units.told(value) for name, value in found["temperature"].items()}
    return told | {"target": given["target"], "temperature": temperature}


async def _demand(client: Client, zone: str, given: Answer, units: _Units) -> Answer:
    body: Answer = {"horizon": f"{given['horizon']}h"}
    if "setpoint" in given:
        body["T_set"] = units.asked(given["setpoint"])
    found = await client.ask("POST", f"/zones/{zone}/demand", body)
    return {name: found[name] for name in ("trust", "planned", "total", "hours")}


async def _what_if(client: Client, zone: str, given: Answer, units: _Units) -> Answer:
    plans = [{"name": f"{one:g}", "T_set": units.asked(one)} for one in given["setpoints"]]
    body = {"horizon": f"{given['horizon']}h", "plans": plans}
    if "price" in given:
        body["price"] = given["price"]
    found = await client.ask("POST", f"/zones/{zone}/what-if", body)
    return {name: found[name] for name in ("trust", "plans", "differences")}


Asked = Callable[[Client, str, Answer, _Units], Awaitable[Answer]]

_SERVICES: dict[str, tuple[Asked, dict[vol.Marker, Any]]] = {
    "forecast": (_forecast, _ROOM | _HORIZON | _SETPOINT),
    "demand": (_demand, _ROOM | _HORIZON | _SETPOINT),
    "preheat": (
        _preheat,
        _ROOM
        | {
            vol.Required("target"): _NUMBER,
            vol.Required("by"): cv.time,
            vol.Optional("probability", default=0.9): _NUMBER,
        },
    ),
    "what_if": (
        _what_if,
        _ROOM
        | _HORIZON
        | {vol.Required("setpoints"): vol.All([_NUMBER], vol.Length(2, 20)), vol.Optional("price"): _NUMBER},
    ),
}


def register(hass: HomeAssistant) -> None:
    for name, (asked, fields) in _SERVICES.items():

        async def handle(call: ServiceCall, asked: Asked = asked) -> Answer:
            coordinator, zone = _room(hass, call.data["device_id"])
            try:
                return await asked(coordinator.client, zone, dict(call.data), _Units(hass))
            except Refused as error:
                raise ServiceValidationError(str(error)) from error
            except DaemonError as error:
                raise HomeAssistantError(str(error)) from error

        hass.services.async_register(DOMAIN, name, handle, vol.Schema(fields), SupportsResponse.ONLY)


def _room(hass: HomeAssistant, device_id: str) -> tuple[Coordinator, str]:
    """The daemon and the zone that a device stands for. ServiceValidationError if there is none."""
    device = device_registry.async_get(hass).async_get(device_id)
    identifiers = {} if device is None else dict(device.identifiers)
    for coordinator in hass.data[DOMAIN].values():
        for zone in coordinator.rooms:
            if identifiers.get(DOMAIN) == f"{coordinator.site}/{zone}":
                return coordinator, zone
    raise ServiceValidationError(
        f"'{device_id}' is no room of a Thermogate daemon that is set up now; choose a device of the integration"
    )
