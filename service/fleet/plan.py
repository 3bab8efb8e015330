"""What the steward wants of the fleet: which zones there are, and which shard runs each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from service.config.site import Config
from service.daemon.supply.feeds import narrowed
from service.fleet.sharding import keys, owners

QUARANTINE = "quarantine"
"""The shard of the zones that brought down the process they were in."""


def shard_names(count: int) -> tuple[str, ...]:
    """The names of so many shards."""
    return tuple(f"shard-{number}" for number in range(count))


class Plan(NamedTuple):
    """A later plan has a greater `version`."""

    version: int
    config: Config
    shards: tuple[str, ...]
    """The shards without the one for quarantined zones."""
    quarantined: frozenset[str] = frozenset()
    moving: frozenset[str] = frozenset()
    """Zones that no shard may run: those that had them let go of them first."""

    @property
    def all_shards(self) -> tuple[str, ...]:
        """Every shard that there should be."""
        return (*self.shards, QUARANTINE) if self.quarantined else self.shards

    def owners(self) -> dict[str, str]:
        """The shard of every zone, of those that are moving as well."""
        key = keys(self.config)
        shard = owners(sorted(set(key.values())), self.shards)
        return {zone: QUARANTINE if zone in self.quarantined else shard[key[zone]] for zone in key}

    def shares(self) -> dict[str, Config]:
        """The configuration of every shard: the whole one with its zones alone, and with names of its own at brokers,
        which let nobody in twice."""
        owner = self.owners()
        zones: dict[str, list[str]] = {shard: [] for shard in self.all_shards}
        for zone in self.config.zones:
            if zone.id not in self.moving:
                zones[owner[zone.id]].append(zone.id)
        return {shard: _named(narrowed(self.config, names), shard) for shard, names in zones.items()}

    def followed_by(
        self,
        config: Config | None = None,
        shards: Sequence[str] | None = None,
        quarantined: frozenset[str] | None = None,
    ) -> Plan:
        """The next plan. Where zones have to change hands, it first takes them from those who have them; `settled`
        then gives them to their new shards."""
        after = Plan(
            self.version + 1,
            self.config if config is None else config,
            self.shards if shards is None else tuple(shards),
            self.quarantined if quarantined is None else quarantined,
        )
        owner = after.owners()
        # A zone that was on its way may not have left the shard from which it came.
        return after._replace(moving=moved(self.owners(), owner) | (self.moving & owner.keys()))

    def settled(self) -> Plan:
        """The plan once no shard has the zones any more that were to move."""
        return self._replace(version=self.version + 1, moving=frozenset())


def moved(before: Mapping[str, str], after: Mapping[str, str]) -> frozenset[str]:
    """The zones that both have, with different shards."""
    return frozenset(zone for zone, shard in after.items() if before.get(zone, shard) != shard)


def _named(config: Config, shard: str) -> Config:
    names = {name: getattr(table, "client_id", None) for name, table in config.sources.items()}
    sources = {
        name: table.model_copy(update={"client_id": f"{names[name]}-{shard}"}) if names[name] else table
        for name, table in config.sources.items()
    }
    return config.model_copy(update={"sources": sources})
