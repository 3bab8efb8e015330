"""A room: the entities that it is measured by, what is posted of them, and its tables in the daemon's configuration."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

from homeassistant.components.climate import ATTR_CURRENT_TEMPERATURE, ATTR_HVAC_ACTION, HVACAction
from homeassistant.const import (
    ATTR_TEMPERATURE,
    ATTR_UNIT_OF_MEASUREMENT,
    PERCENTAGE,
    STATE_OFF,
    STATE_ON,
    UnitOfPower,
    UnitOfTemperature,
)
from homeassistant.core import HomeAssistant, State, split_entity_id
from homeassistant.util.unit_conversion import PowerConverter, TemperatureConverter

SOURCE = "home-assistant"
"""Name of the source in the daemon's configuration."""
_UNITS = {
    UnitOfTemperature.CELSIUS: "degC",
    UnitOfTemperature.FAHRENHEIT: "degF",
    UnitOfTemperature.KELVIN: "K",
    UnitOfPower.WATT: "W",
    UnitOfPower.KILO_WATT: "kW",
    "MW": "MW",
    "BTU/h": "BTU/h",
}
"""Home Assistant's units as Thermogate's configuration writes them."""
SWITCHES = ("switch", "binary_sensor", "input_boolean")
"""Domains of what is on or off."""
_HEATS = (HVACAction.HEATING, "preheating")


@dataclass(frozen=True)
class Place:
    """Where a channel comes from: an entity's state or one of its attributes, in `unit`, times `scale`."""

    entity: str
    unit: str
    attribute: str | None = None
    scale: float | None = None
    """W at 1: of what is on or off, and 100 times less of a valve in percent. None: the value is a quantity itself."""

    @property
    def toml(self) -> str:
        """As a channel of a source that reads the recorder's database."""
        attribute = "" if self.attribute is None else f'attribute = "{self.attribute}", '
        scale = "" if self.scale is None else f", scale = {self.scale:g}"
        return f'{{ source = "past", entity = "{self.entity}", {attribute}unit = "{_UNITS[self.unit]}"{scale} }}'

    def read(self, hass: HomeAssistant) -> float | None:
        """The current value in degC or W; None where there is none."""
        state = hass.states.get(self.entity)
        if state is None:
            return None
        value = state.state if self.attribute is None else state.attributes.get(self.attribute)
        if self.scale is not None and (level := _level(value)) is not None:
            return level * self.scale
        try:
            number = float(value)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            return None
        if number != number or abs(number) == float("inf"):
            return None
        if self.scale is not None:
            return number * self.scale
        if self.unit in PowerConverter.VALID_UNITS:
            return PowerConverter.convert(number, self.unit, UnitOfPower.WATT)
        return TemperatureConverter.convert(number, self.unit, UnitOfTemperature.CELSIUS)


def _level(word: object) -> float | None:
    """What is on or off as 1 or 0; None for anything else."""
    if word in (STATE_ON, *_HEATS):
        return 1.0
    return 0.0 if word in (STATE_OFF, HVACAction.IDLE, "cooling", "drying", "fan", "defrosting") else None


@dataclass(frozen=True)
class Room:
    """The entities that a zone of the daemon is measured by."""

    zone: str
    climate: str
    heating: str | None = None
    """Power, valve or switch; None: the action of the thermostat."""
    power: float = 1500.0
    """W at full heating, unless `heating` is a power."""
    outdoor: str | None = None
    """A thermometer or a weather; None: the first weather that there is."""

    def stored(self) -> dict[str, Any]:
        """As kept in the options of the config entry."""
        return asdict(self)

    def places(self, hass: HomeAssistant) -> dict[str, Place]:
        """Where each channel comes from now; what cannot be known from the entities' states is left out."""
        own = hass.config.units.temperature_unit
        found = {
            "T_i": Place(self.climate, own, ATTR_CURRENT_TEMPERATURE),
            "setpoint": Place(self.climate, own, ATTR_TEMPERATURE),
            "T_out": self._outdoor(hass),
            "u_heat": self._heat(hass),
        }
        return {channel: place for channel, place in found.items() if place is not None}

    def _outdoor(self, hass: HomeAssistant) -> Place | None:
        chosen = self.outdoor or next(iter(sorted(hass.states.async_entity_ids("weather"))), None)
        state = None if chosen is None else hass.states.get(chosen)
        if state is None:
            return None
        if split_entity_id(chosen)[0] == "weather":
            unit = state.attributes.get("temperature_unit", hass.config.units.temperature_unit)
            return Place(chosen, unit, ATTR_TEMPERATURE)
        unit = state.attributes.get(ATTR_UNIT_OF_MEASUREMENT)
        return Place(chosen, unit) if unit in TemperatureConverter.VALID_UNITS else None

    def _heat(self, hass: HomeAssistant) -> Place | None:
        if self.heating is None:
            return Place(self.climate, UnitOfPower.WATT, ATTR_HVAC_ACTION, self.power)
        state = hass.states.get(self.heating)
        return None if state is None else self._measured(state)

    def _measured(self, state: State) -> Place | None:
        unit = state.attributes.get(ATTR_UNIT_OF_MEASUREMENT)
        # Newer releases convert more units than a configuration can have.
        if unit in PowerConverter.VALID_UNITS and unit in _UNITS:
            return Place(state.entity_id, unit)
        if unit == PERCENTAGE:
            return Place(state.entity_id, UnitOfPower.WATT, None, self.power / 100.0)
        if split_entity_id(state.entity_id)[0] in SWITCHES:
            return Place(state.entity_id, UnitOfPower.WATT, None, self.power)
        return None

    def values(self, hass: HomeAssistant) -> dict[str, float]:
        """The current value of each channel that has one, in degC or W."""
        read = {channel: place.read(hass) for channel, place in self.places(hass).items()}
        return {channel: value for channel, value in read.items() if value is not None}

    def readings(self, hass: HomeAssistant, now: datetime) -> list[dict[str, Any]]:
        """The current values, as the daemon takes them."""
        return [
            {
                "channel": f"{self.zone}/{channel}",
                "value": value,
                "time": now.isoformat(),
                "unit": "W" if channel == "u_heat" else "degC",
            }
            for channel, value in self.values(hass).items()
        ]

    def missing(self, hass: HomeAssistant) -> list[str]:
        """The chosen entities that no longer exist."""
        chosen = (self.climate, self.heating, self.outdoor)
        return [entity for entity in chosen if entity is not None and hass.states.get(entity) is None]

    def tables(self, hass: HomeAssistant) -> str:
        """The zone in the daemon's configuration."""
        heat = self.places(hass).get("u_heat")
        limit = "" if heat is None or heat.scale is None else f", installed = {self.power:g}"
        return f"""[[zones]]
id = "{self.zone}"
period = "5min"
lateness = "2min"
network = "auto"

[zones.channels]
T_i = {{ source = "{SOURCE}", unit = "degC" }}
T_out = {{ source = "{SOURCE}", unit = "degC" }}
u_heat = {{ source = "{SOURCE}", unit = "W", aggregate = "mean"{limit} }}

[zones.setpoint]
source = "{SOURCE}"
unit = "degC"
"""

    def history(self, hass: HomeAssistant) -> str:
        """The recorder's history of the zone, for `thermogate learn`."""
        places = self.places(hass)
        lines = [f"{channel} = {place.toml}" for channel, place in places.items() if channel != "setpoint"]
        channels = "\n".join(lines)
        return f"""[sources.past]
kind = "home-assistant"
file = "home-assistant_v2.db"

[[zones]]
id = "{self.zone}"
setpoint = {places["setpoint"].toml}

[zones.channels]
{channels}
"""


def site_tables(hass: HomeAssistant) -> str:
    """What a configuration begins with."""
    return f"""[site]
id = "home"
time_zone = {json.dumps(hass.config.time_zone)}
latitude = {hass.config.latitude:.2f}
longitude = {hass.config.longitude:.2f}

[sources.{SOURCE}]
kind = "http"

"""
