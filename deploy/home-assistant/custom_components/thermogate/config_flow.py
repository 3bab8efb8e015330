"""Setting up: choose a room's entities, give its zone to a daemon, connect to that daemon."""

from __future__ import annotations

import re
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

import voluptuous as vol
from homeassistant.config_entries import ConfigEntry, ConfigFlow, OptionsFlow
from homeassistant.const import CONF_API_KEY, CONF_URL, CONF_VERIFY_SSL
from homeassistant.core import HomeAssistant, callback
from homeassistant.helpers import selector
from homeassistant.util import dt, slugify

from .client import Client, DaemonError, Refused
from .coordinator import DOMAIN, ROOMS, client_of, not_taken
from .room import SWITCHES, Room, site_tables

_ZONE = re.compile(r"[a-z0-9][a-z0-9_-]{0,63}")
_NEW = "+"
_DAEMON_URL = "http://127.0.0.1:8080"

Errors = dict[str, str]


def _entity(*domains: str, **more: Any) -> selector.EntitySelector:
    return selector.EntitySelector(selector.EntitySelectorConfig(filter=[{"domain": list(domains), **more}]))


_ROOM_FORM = vol.Schema(
    {
        vol.Required("climate"): _entity("climate"),
        vol.Optional("heating"): _entity("sensor", "number", "input_number", *SWITCHES),
        vol.Required("power", default=1500): selector.NumberSelector(
            selector.NumberSelectorConfig(min=1, max=1e6, unit_of_measurement="W", mode="box")
        ),
        vol.Optional("outdoor"): _entity("sensor", "weather"),
        vol.Optional("zone"): selector.TextSelector(),
    }
)

_DAEMON_FORM = vol.Schema(
    {
        vol.Required(CONF_URL, default=_DAEMON_URL): selector.TextSelector(),
        vol.Required(CONF_API_KEY): selector.TextSelector(selector.TextSelectorConfig(type="password")),
        vol.Required(CONF_VERIFY_SSL, default=True): bool,
    }
)


def room_of(hass: HomeAssistant, given: Mapping[str, Any]) -> tuple[Room, Errors]:
    """The room that was entered, and what cannot be measured of it, by field."""
    chosen = {name: given[name] for name in ("climate", "heating", "outdoor") if given.get(name)}
    zone = (given.get("zone") or slugify(given["climate"].partition(".")[2])).strip()
    room = Room(zone, power=given["power"], **chosen)
    measured, errors = room.values(hass), {}
    if not _ZONE.fullmatch(zone):
        errors["zone"] = "zone_name"
    if "T_i" not in measured:
        errors["climate"] = "no_temperature"
    if "T_out" not in measured:
        errors["outdoor"] = "no_outdoor"
    if "u_heat" not in measured:
        errors["heating"] = "no_heating"
    return room, errors


async def introduce(hass: HomeAssistant, client: Client, room: Room) -> tuple[str | None, str]:
    """What keeps the daemon from taking the room's readings: an error of the form (None: nothing) and a sentence.

    A daemon that does not know the zone is told to read its configuration again.
    """
    body = {"readings": room.readings(hass, dt.utcnow())}
    try:
        taken = await _posted(client, body)
        if not_taken(taken):
            try:
                await client.ask("POST", "/admin/reload")
            except Refused as error:
                return "reload_refused", str(error)
            taken = await _posted(client, body)
    except DaemonError as error:
        return error.form_error, str(error)
    if unknown := not_taken(taken):
        return "zone_unknown", ", ".join(unknown)
    if refused := taken["refused"].keys() & {"wrong_unit", "out_of_range"}:
        return "refused", ", ".join(sorted(refused))
    return None, ""


async def _posted(client: Client, body: dict[str, Any]) -> dict[str, Any]:
    """The answer to a post; a daemon without a source that is posted to knows none of the names."""
    try:
        return await client.ask("POST", "/readings", body)
    except Refused as error:
        if error.status != HTTPStatus.CONFLICT:
            raise
    return {"unknown_names": [reading["channel"] for reading in body["readings"]], "refused": {}}


class ThermogateFlow(ConfigFlow, domain=DOMAIN):
    """Sets up a daemon with its first room, or one more room of a daemon that is set up."""

    VERSION = 1

    def __init__(self) -> None:
        self._room: Room | None = None

    @staticmethod
    @callback
    def async_get_options_flow(config_entry: ConfigEntry) -> RoomsFlow:
        return RoomsFlow(config_entry)

    async def async_step_user(self, user_input: dict[str, Any] | None = None) -> Any:
        """The entities of the room."""
        errors: Errors = {}
        if user_input is not None:
            self._room, errors = room_of(self.hass, user_input)
            if not errors:
                return await self.async_step_daemon()
        form = self.add_suggested_values_to_schema(_ROOM_FORM, user_input)
        return self.async_show_form(step_id="user", data_schema=form, errors=errors)

    async def async_step_daemon(self, user_input: dict[str, Any] | None = None) -> Any:
        """The configuration of the daemon, and where it is."""
        assert self._room is not None
        room, error, problem = self._room, None, ""
        if user_input is not None:
            client = client_of(self.hass, user_input)
            error, problem = await introduce(self.hass, client, room)
            if error is None:
                try:
                    site = (await client.ask("GET", "/zones"))["site"]
                except DaemonError as refusal:
                    error, problem = refusal.form_error, str(refusal)
                else:
                    return await self._finish(site, user_input, room)
        return self.async_show_form(
            step_id="daemon",
            data_schema=self.add_suggested_values_to_schema(_DAEMON_FORM, user_input),
            errors={} if error is None else {"base": error},
            description_placeholders={
                "toml": site_tables(self.hass) + room.tables(self.hass),
                "history": room.history(self.hass),
                "problem": problem,
            },
        )

    async def _finish(self, site: str, data: dict[str, Any], room: Room) -> Any:
        entry = await self.async_set_unique_id(site)
        if entry is None:
            return self.async_create_entry(title=site, data=data, options={ROOMS: {room.zone: room.stored()}})
        rooms = entry.options[ROOMS] | {room.zone: room.stored()}
        return self.async_update_reload_and_abort(
            entry, data=data, options={**entry.options, ROOMS: rooms}, reason="room_added"
        )

    async def async_step_reauth(self, entry_data: Mapping[str, Any]) -> Any:
        """The key is no longer accepted."""
        return await self.async_step_reconnect()

    async def async_step_reconfigure(self, user_input: dict[str, Any] | None = None) -> Any:
        """The daemon has moved."""
        return await self.async_step_reconnect()

    async def async_step_reconnect(self, user_input: dict[str, Any] | None = None) -> Any:
        """Another address or key for the same daemon."""
        entry = self.hass.config_entries.async_get_entry(self.context["entry_id"])
        assert entry is not None
        error, problem = None, ""
        if user_input is not None:
            client = client_of(self.hass, user_input)
            try:
                # A key that only reads would do for the second question.
                await client.ask("POST", "/readings", {"readings": []})
                site = (await client.ask("GET", "/zones"))["site"]
            except DaemonError as refusal:
                error, problem = refusal.form_error, str(refusal)
            else:
                if site == entry.unique_id:
                    return self.async_update_reload_and_abort(entry, data=user_input, reason="reauth_successful")
                error, problem = "another_site", str(site)
        shown = user_input or {name: entry.data[name] for name in (CONF_URL, CONF_VERIFY_SSL)}
        return self.async_show_form(
            step_id="reconnect",
            data_schema=self.add_suggested_values_to_schema(_DAEMON_FORM, shown),
            errors={} if error is None else {"base": error},
            description_placeholders={"problem": problem},
        )


class RoomsFlow(OptionsFlow):
    """Adds a room, or changes the entities of one. Deleting its device gives a room up."""

    def __init__(self, entry: ConfigEntry) -> None:
        self._entry = entry
        self._before: dict[str, Any] = {}
        self._room: Room | None = None

    async def async_step_init(self, user_input: dict[str, Any] | None = None) -> Any:
        """Which room."""
        rooms = self._entry.options[ROOMS]
        if user_input is not None:
            self._before = rooms.get(user_input["room"], {})
            return await self.async_step_room()
        options = [{"value": zone, "label": zone} for zone in rooms] + [{"value": _NEW, "label": "+"}]
        choice = selector.SelectSelector(selector.SelectSelectorConfig(options=options, mode="list"))
        return self.async_show_form(
            step_id="init", data_schema=vol.Schema({vol.Required("room", default=_NEW): choice})
        )

    async def async_step_room(self, user_input: dict[str, Any] | None = None) -> Any:
        """Its entities."""
        errors: Errors = {}
        if user_input is not None:
            if self._before:
                user_input["zone"] = self._before["zone"]
            self._room, errors = room_of(self.hass, user_input)
            if not errors:
                return await self.async_step_zone()
        form = self.add_suggested_values_to_schema(_ROOM_FORM, user_input or self._before)
        return self.async_show_form(step_id="room", data_schema=form, errors=errors)

    async def async_step_zone(self, user_input: dict[str, Any] | None = None) -> Any:
        """The zone in the daemon's configuration, unless it is there already."""
        assert self._room is not None
        room = self._room
        error, problem = await introduce(self.hass, client_of(self.hass, dict(self._entry.data)), room)
        if error is None:
            options = {**self._entry.options, ROOMS: self._entry.options[ROOMS] | {room.zone: room.stored()}}
            self.hass.config_entries.async_update_entry(self._entry, options=options)
            self.hass.config_entries.async_schedule_reload(self._entry.entry_id)
            return self.async_create_entry(title="", data=options)
        shown = user_input is not None or error != "zone_unknown"
        return self.async_show_form(
            step_id="zone",
            data_schema=vol.Schema({}),
            errors={"base": error} if shown else {},
            description_placeholders={
                "toml": room.tables(self.hass),
                "history": room.history(self.hass),
                "problem": problem,
            },
        )
