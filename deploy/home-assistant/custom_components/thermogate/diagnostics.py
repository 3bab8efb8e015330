"""What a report of an error should contain."""

from __future__ import annotations

from typing import Any

from homeassistant.components.diagnostics import async_redact_data
from homeassistant.config_entries import ConfigEntry
from homeassistant.const import CONF_API_KEY, CONF_URL
from homeassistant.core import HomeAssistant

from .coordinator import DOMAIN, Coordinator


async def async_get_config_entry_diagnostics(hass: HomeAssistant, entry: ConfigEntry) -> dict[str, Any]:
    """The settings without address and key, what is measured now, and what the daemon said last."""
    coordinator: Coordinator = hass.data[DOMAIN][entry.entry_id]
    return {
        "settings": async_redact_data(dict(entry.data), {CONF_API_KEY, CONF_URL}),
        "rooms": {zone: room.stored() for zone, room in coordinator.rooms.items()},
        "values": {zone: room.values(hass) for zone, room in coordinator.rooms.items()},
        "connected": coordinator.last_update_success,
        "taken": coordinator.taken,
        "announced": coordinator.data,
    }
