"""What passes between Home Assistant and a daemon: readings there every minute, everything that zones announce back."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from datetime import timedelta
from typing import Any

from homeassistant.config_entries import ConfigEntry
from homeassistant.const import CONF_API_KEY, CONF_URL, CONF_VERIFY_SSL
from homeassistant.core import HomeAssistant, callback
from homeassistant.exceptions import ConfigEntryAuthFailed
from homeassistant.helpers import issue_registry
from homeassistant.helpers.aiohttp_client import async_get_clientsession
from homeassistant.helpers.update_coordinator import DataUpdateCoordinator, UpdateFailed
from homeassistant.util import dt

from .client import Client, DaemonError, KeyRefused
from .room import Room

DOMAIN = "thermogate"
ROOMS = "rooms"
"""Key of the options: the rooms by zone."""
INTERVAL = timedelta(minutes=1)
KEPT = 3
"""The newest posts, which are sent again after an outage: the zones take readings that are two minutes late."""
ADVICE_EVERY = timedelta(hours=1)
FOR_EXPERTS = {
    *("parameter-at-bound", "parameter-not-identified", "members-disagree", "network-variant", "narrower-bounds"),
}
"""Findings for those who read parameters: nothing in the house need be repaired for them."""
RECONNECT = 10.0
"""s until a stream that ended is opened again."""

Topics = dict[str, dict[str, Any]]
"""The newest document of each topic of a zone."""

_log = logging.getLogger(__name__)


def client_of(hass: HomeAssistant, data: dict[str, Any]) -> Client:
    """The daemon that a config entry's `data` names."""
    session = async_get_clientsession(hass, verify_ssl=data[CONF_VERIFY_SSL])
    return Client(session, data[CONF_URL], data[CONF_API_KEY], hass.config.language)


def not_taken(taken: dict[str, Any]) -> list[str]:
    """The channels that the daemon does not know, by its answer to a post; a zone need not have a set-point."""
    return sorted(name for name in taken.get("unknown_names", ()) if not name.endswith("/setpoint"))


class Coordinator(DataUpdateCoordinator[dict[str, Topics]]):
    """The rooms of a daemon. Its data are what the zones announced last."""

    def __init__(self, hass: HomeAssistant, entry: ConfigEntry) -> None:
        super().__init__(hass, _log, name=f"Thermogate {entry.title}", update_interval=INTERVAL)
        self.client = client_of(hass, dict(entry.data))
        self.rooms = {zone: Room(**stored) for zone, stored in entry.options[ROOMS].items()}
        self.site = entry.unique_id
        self.data = {zone: {} for zone in self.rooms}
        self.heard: set[str] = set()
        """The zones whose streams are open and have begun."""
        self.taken: dict[str, Any] = {}
        """The daemon's answer to the last post."""
        self._waiting: deque[list[dict[str, Any]]] = deque(maxlen=KEPT)
        self._advised = dt.utc_from_timestamp(0)
        self._issues: set[str] = set()

    async def _async_update_data(self) -> dict[str, Topics]:
        now = dt.utcnow()
        self._waiting.append([one for room in self.rooms.values() for one in room.readings(self.hass, now)])
        try:
            readings = [reading for post in self._waiting for reading in post]
            self.taken = await self.client.ask("POST", "/readings", {"readings": readings})
            self._waiting.clear()
            if now - self._advised >= ADVICE_EVERY:
                await self._advise()
                self._advised = now
        except KeyRefused as error:
            raise ConfigEntryAuthFailed(str(error)) from error
        except DaemonError as error:
            raise UpdateFailed(str(error)) from error
        self.report()
        return self.data

    async def _advise(self) -> None:
        """Ask what there is to do in each room, which a zone without a sample cannot say yet."""
        for zone, topics in self.data.items():
            try:
                topics["room"] = await self.client.ask("GET", f"/zones/{zone}/room", params=self.client.spoken)
            except KeyRefused:
                raise
            except DaemonError as error:
                _log.debug("zone '%s' gives no advice: %s", zone, error)

    async def follow(self, zone: str) -> None:
        """Take what `zone` announces, for as long as the key is accepted."""
        refused = False
        while not refused:
            try:
                async for topic, document in self.client.events(zone):
                    self.data[zone][topic] = document
                    if topic == "status":
                        self.heard.add(zone)
                    self.report()
                    self.async_update_listeners()
            except KeyRefused:
                # A daemon soon holds up whoever goes on with a wrong key; the posts would wait too.
                refused = True
                self.config_entry.async_start_reauth(self.hass)
            except DaemonError as error:
                # The posts notice an outage, and log it once.
                _log.debug("the stream of zone '%s' is lost: %s", zone, error)
            self.heard.discard(zone)
            self.async_update_listeners()
            await asyncio.sleep(0 if refused else RECONNECT)

    @callback
    def report(self) -> None:
        """Raise an issue for what can be mended and for what cannot be measured, and withdraw those that are over."""
        found: dict[str, tuple[str, dict[str, str]]] = {}
        for zone, topics in self.data.items():
            for finding in topics.get("status", {}).get("findings", ()):
                if finding["finding"] in FOR_EXPERTS:
                    continue
                name = f"{self.site}/{zone} {finding['finding']} {finding['subject']}"
                found[name] = ("finding", {"room": zone, "sentence": finding["sentence"]})
            if self.hass.is_running:
                for entity in self.rooms[zone].missing(self.hass):
                    found[f"{self.site}/{zone} {entity}"] = ("entity_missing", {"room": zone, "entity": entity})
        if unknown := not_taken(self.taken):
            found[f"{self.site} unknown"] = ("not_taken", {"channels": ", ".join(unknown)})
        for name in self._issues - found.keys():
            issue_registry.async_delete_issue(self.hass, DOMAIN, name)
        for name, (key, placeholders) in found.items():
            issue_registry.async_create_issue(
                self.hass,
                DOMAIN,
                name,
                is_fixable=False,
                severity=issue_registry.IssueSeverity.WARNING,
                translation_key=key,
                translation_placeholders=placeholders,
            )
        self._issues = set(found)

    @callback
    def forget(self) -> None:
        """Withdraw every issue."""
        for name in self._issues:
            issue_registry.async_delete_issue(self.hass, DOMAIN, name)
        self._issues = set()
