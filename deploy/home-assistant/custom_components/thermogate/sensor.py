"""The sensors of a room: the hours ahead, trust in them, when to start heating, and heat that nobody measures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from homeassistant.components.sensor import SensorDeviceClass, SensorEntity, SensorEntityDescription, SensorStateClass
from homeassistant.config_entries import ConfigEntry
from homeassistant.const import EntityCategory, UnitOfPower, UnitOfTemperature
from homeassistant.core import HomeAssistant
from homeassistant.helpers.device_registry import DeviceEntryType, DeviceInfo
from homeassistant.helpers.entity_platform import AddEntitiesCallback
from homeassistant.helpers.update_coordinator import CoordinatorEntity
from homeassistant.util import dt
from homeassistant.util.unit_conversion import TemperatureConverter

from .coordinator import DOMAIN, Coordinator, Topics

PARALLEL_UPDATES = 0
"""Nothing is asked entity by entity."""
HOURS = {"1h": 3600, "6h": 21600, "1d": 86400}
"""Leads that are shown, s."""
_LONGEST_STATE = 255

Shown = Callable[[float], float]
"""From degC to the unit that Home Assistant shows."""


@dataclass(frozen=True, kw_only=True)
class Described(SensorEntityDescription):
    """A sensor, and how its value and attributes come from what the zone announced; None where it did not."""

    value: Callable[[Topics], Any]
    attributes: Callable[[Topics, Shown], Mapping[str, Any]] = lambda topics, shown: {}
    vouched: bool = False
    """Whether it is unavailable while the zone is not running."""


def _at(topics: Topics, lead: int) -> Mapping[str, Any]:
    """The forecast so far ahead; empty without one."""
    outputs = topics.get("ahead", {}).get("outputs") or [{}]
    return next((one for one in outputs[0].get("horizons", ()) if one["lead_s"] == lead), {})


def _bounds(topics: Topics, shown: Shown, lead: int) -> dict[str, Any]:
    found = _at(topics, lead)
    if not found:
        return {}
    told = {"valid_time": found["valid_time"], "quality": topics["ahead"]["quality"]}
    told |= {name: shown(found[name]) for name in ("lower", "upper")}
    if lead == max(HOURS.values()):
        ahead = topics["ahead"]
        columns = {name: [shown(value) for value in ahead["outputs"][0][name]] for name in ("mean", "lower", "upper")}
        told["fan"] = {"start": ahead["valid_time"], "step_s": ahead["step_s"], **columns}
    return told


def _trust(topics: Topics, lead: int) -> Mapping[str, Any]:
    return next((one for one in topics.get("trust", {}).get("horizons", ()) if one["lead_s"] == lead), {})


def _start(topics: Topics) -> datetime | None:
    heating = topics.get("ahead", {}).get("heating")
    return None if not heating or heating["start"] is None else dt.parse_datetime(heating["start"])


def _heating(topics: Topics, shown: Shown) -> Mapping[str, Any]:
    heating = topics.get("ahead", {}).get("heating")
    return {} if not heating else {"target": shown(heating["target"])} | {k: heating[k] for k in ("by", "reached")}


def _advice(topics: Topics) -> str | None:
    if "room" not in topics:
        return None
    return next((one["what"][:_LONGEST_STATE] for one in topics["room"]["to_do"]), "")


SENSORS = (
    *(
        Described(
            key=f"forecast_{hour}",
            device_class=SensorDeviceClass.TEMPERATURE,
            native_unit_of_measurement=UnitOfTemperature.CELSIUS,
            state_class=SensorStateClass.MEASUREMENT,
            suggested_display_precision=1,
            value=lambda topics, lead=lead: _at(topics, lead).get("mean"),
            attributes=lambda topics, shown, lead=lead: _bounds(topics, shown, lead),
            vouched=True,
        )
        for hour, lead in HOURS.items()
    ),
    *(
        Described(
            key=f"trust_{hour}",
            device_class=SensorDeviceClass.ENUM,
            options=["learning", "trusted", "doubtful", "untrusted"],
            value=lambda topics, lead=lead: _trust(topics, lead).get("trust"),
            attributes=lambda topics, _, lead=lead: {
                name: told[name]
                for told in (topics.get("trust", {}) | _trust(topics, lead),)
                for name in ("reason", "planned", "beaten")
                if name in told
            },
        )
        for hour, lead in HOURS.items()
    ),
    Described(
        key="quality",
        device_class=SensorDeviceClass.ENUM,
        options=["good", "uncertain", "bad"],
        value=lambda topics: topics.get("ahead", topics.get("forecast", {})).get("quality"),
        vouched=True,
    ),
    Described(
        key="start_heating",
        device_class=SensorDeviceClass.TIMESTAMP,
        value=_start,
        attributes=_heating,
        vouched=True,
    ),
    Described(
        key="unmeasured_heat",
        device_class=SensorDeviceClass.POWER,
        native_unit_of_measurement=UnitOfPower.WATT,
        state_class=SensorStateClass.MEASUREMENT,
        suggested_display_precision=0,
        value=lambda topics: topics.get("gain", {}).get("median"),
        attributes=lambda topics, _: {name: topics["gain"][name] for name in ("lower", "upper") if "gain" in topics},
        vouched=True,
    ),
    Described(
        key="advice",
        value=_advice,
        attributes=lambda topics, _: {name: topics["room"][name] for name in ("to_do", "answers") if "room" in topics},
    ),
    Described(
        key="state",
        device_class=SensorDeviceClass.ENUM,
        options=["waiting", "running", "stalled", "failed"],
        entity_category=EntityCategory.DIAGNOSTIC,
        value=lambda topics: topics["status"]["state"],
        attributes=lambda topics, _: {"reason": topics["status"]["reason"]},
    ),
)


async def async_setup_entry(hass: HomeAssistant, entry: ConfigEntry, async_add_entities: AddEntitiesCallback) -> None:
    """Add the sensors of every room."""
    coordinator: Coordinator = hass.data[DOMAIN][entry.entry_id]
    async_add_entities(ZoneSensor(coordinator, zone, one) for zone in coordinator.rooms for one in SENSORS)


class ZoneSensor(CoordinatorEntity[Coordinator], SensorEntity):
    _attr_has_entity_name = True
    _unrecorded_attributes = frozenset({"fan", "to_do", "answers"})
    entity_description: Described

    def __init__(self, coordinator: Coordinator, zone: str, description: Described) -> None:
        super().__init__(coordinator)
        self.entity_description = description
        self._zone = zone
        identity = f"{coordinator.site}/{zone}"
        self._attr_translation_key = description.key
        self._attr_unique_id = f"{identity}/{description.key}"
        self._attr_device_info = DeviceInfo(
            identifiers={(DOMAIN, identity)},
            name=f"Thermogate {zone}",
            manufacturer="Thermogate",
            model="thermal model of a zone",
            entry_type=DeviceEntryType.SERVICE,
            configuration_url=f"{coordinator.client.url}/#/zone/{zone}",
        )

    @property
    def _topics(self) -> Topics:
        return self.coordinator.data[self._zone]

    @property
    def available(self) -> bool:
        if not super().available or self._zone not in self.coordinator.heard:
            return False
        return self._topics["status"]["state"] == "running" or not self.entity_description.vouched

    @property
    def native_value(self) -> Any:
        return self.entity_description.value(self._topics)

    @property
    def extra_state_attributes(self) -> Mapping[str, Any]:
        return self.entity_description.attributes(self._topics, self._shown)

    def _shown(self, value: float) -> float:
        unit = self.hass.config.units.temperature_unit
        return round(TemperatureConverter.convert(value, UnitOfTemperature.CELSIUS, unit), 2)
