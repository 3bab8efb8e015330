"""Thermogate in Home Assistant: posts what a room is measured by, and shows what the daemon forecasts."""

from __future__ import annotations

from homeassistant.config_entries import ConfigEntry
from homeassistant.const import Platform
from homeassistant.core import HomeAssistant
from homeassistant.helpers import config_validation
from homeassistant.helpers.device_registry import DeviceEntry
from homeassistant.helpers.typing import ConfigType

from .coordinator import DOMAIN, ROOMS, Coordinator
from .services import register

CONFIG_SCHEMA = config_validation.config_entry_only_config_schema(DOMAIN)
PLATFORMS = (Platform.SENSOR,)


async def async_setup(hass: HomeAssistant, config: ConfigType) -> bool:
    """Register the services, which say what is missing while no daemon is set up."""
    hass.data.setdefault(DOMAIN, {})
    register(hass)
    return True


async def async_setup_entry(hass: HomeAssistant, entry: ConfigEntry) -> bool:
    """Begin to post readings and to follow the zones."""
    coordinator = Coordinator(hass, entry)
    await coordinator.async_config_entry_first_refresh()
    hass.data[DOMAIN][entry.entry_id] = coordinator
    await hass.config_entries.async_forward_entry_setups(entry, PLATFORMS)
    for zone in coordinator.rooms:
        entry.async_create_background_task(hass, coordinator.follow(zone), f"Thermogate {zone}")
    entry.async_on_unload(coordinator.forget)
    return True


async def async_unload_entry(hass: HomeAssistant, entry: ConfigEntry) -> bool:
    """Stop both."""
    if unloaded := await hass.config_entries.async_unload_platforms(entry, PLATFORMS):
        del hass.data[DOMAIN][entry.entry_id]
    return unloaded


async def async_remove_config_entry_device(hass: HomeAssistant, entry: ConfigEntry, device: DeviceEntry) -> bool:
    """Give up the room of a device that is deleted on its page; the daemon keeps what its zone has learned."""
    gone = {zone for zone in entry.options[ROOMS] if (DOMAIN, f"{entry.unique_id}/{zone}") in device.identifiers}
    rooms = {zone: stored for zone, stored in entry.options[ROOMS].items() if zone not in gone}
    hass.config_entries.async_update_entry(entry, options={**entry.options, ROOMS: rooms})
    hass.config_entries.async_schedule_reload(entry.entry_id)
    return True
