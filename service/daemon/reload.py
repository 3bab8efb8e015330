"""What a new configuration changes for a daemon that runs, and what it cannot change."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from adapters.fields.words import listed
from service.config.fitting import fingerprint
from service.config.site import TABLES, Config, ZoneConfig

RELOADABLE = ("log", "fleet", "zones", "sources", "weather")
"""Tables that take effect while the daemon runs, or have none on it; the others do with its next start."""


class Changes(NamedTuple):
    """How one configuration differs from another. Zones that are in none of these go on untouched."""

    added: tuple[ZoneConfig, ...]
    changed: tuple[ZoneConfig, ...]
    removed: tuple[str, ...]
    sources: tuple[str, ...]
    """Sources that both have, with another table."""
    log: bool
    weather: bool = False

    @property
    def fresh(self) -> tuple[ZoneConfig, ...]:
        """The zones that start: those that were added or changed."""
        return (*self.changed, *self.added)

    @property
    def leaving(self) -> frozenset[str]:
        """The zones that stop: those that are removed or start anew."""
        return frozenset({*self.removed, *(zone.id for zone in self.changed)})


def compare(old: Config, new: Config) -> Changes:
    """What has to be done to go from `old` to `new`."""
    before = {zone.id: zone for zone in old.zones}
    sources = tuple(name for name, table in new.sources.items() if name in old.sources and table != old.sources[name])
    # What a recording says depends on its table, and its zones read it from where they stopped; a live source that is
    # reached otherwise goes on telling what is now.
    retold = {name for name in sources if not new.is_live(name)}
    added, changed = [], []
    for zone in new.zones:
        if zone.id not in before:
            added.append(zone)
        elif zone != before[zone.id] or retold & {channel.source for channel in zone.delivered.values()}:
            changed.append(zone)
    now = {zone.id for zone in new.zones}
    removed = tuple(zone for zone in before if zone not in now)
    return Changes(tuple(added), tuple(changed), removed, sources, old.log != new.log, old.weather != new.weather)


def unchangeable(old: Config, new: Config, tables: Iterable[str], but: str = "", remedy: str = "") -> list[str]:
    """A sentence for each of `tables` in which `new` differs from `old` in more than the key `but` ("table.key");
    `remedy` lets it take effect."""
    found = []
    for table in tables:
        before, after = old.table(table), new.table(table)
        keys = [name for name in type(after).model_fields if getattr(before, name) != getattr(after, name)]
        if names := [f"{table}.{key}" for key in keys if f"{table}.{key}" != but]:
            found.append(
                f"{', '.join(names)}: this takes effect with the next start only; {remedy}, or put it back as it was"
            )
    return found


def obstacles(old: Config, new: Config, fingerprints: Mapping[str, str]) -> list[str]:
    """Why a daemon on `old`, whose zones have the `fingerprints`, cannot go over to `new`: one sentence each."""
    tables = [table for table in TABLES if table not in RELOADABLE]
    found = unchangeable(old, new, tables, remedy="restart the daemon")
    for zone in new.zones:
        if zone.id in fingerprints and fingerprints[zone.id] != fingerprint(zone):
            found.append(
                f"zone '{zone.id}': its network, period, estimator or the structure of its options has changed, and "
                "what it has learned belongs to the old ones; put them back, or give the state up with "
                f"`thermogate run CONFIG --reset {zone.id}`"
            )
    return found


_MOST = 20
"""Zones that a line of the log names."""


def summary(changes: Changes) -> str:
    """What was done, as one line."""
    parts = {
        "added": [zone.id for zone in changes.added],
        "changed": [zone.id for zone in changes.changed],
        "removed": list(changes.removed),
    }
    said = [f"{what} {listed(zones, _MOST)}" for what, zones in parts.items() if zones]
    if changes.sources:
        said.append(f"sources changed: {', '.join(changes.sources)}")
    if changes.weather:
        said.append("weather changed")
    if changes.log:
        said.append("log changed")
    return "; ".join(said) or "nothing has changed"
