"""What the steward wants of the fleet: which zones there are, and which shard runs each."""

from typing import NamedTuple

from service.config.site import Config
from service.daemon.supply.feeds import narrowed
from service.fleet.checks import fleet_of
from service.fleet.sharding import keys, owners


class Plan(NamedTuple):
    """A later plan has a greater `version`."""

    version: int
    config: Config

    @property
    def shards(self) -> tuple[str, ...]:
        return shard_names(fleet_of(self.config).shards)

    def owners(self) -> dict[str, str]:
        key = keys(self.config)
        shard = owners(sorted(set(key.values())), self.shards)
        return {zone: shard[key[zone]] for zone in key}

    def share(self, shard: str) -> Config:
        """The configuration with a shard's zones, and its own name at brokers, which let nobody in twice."""
        config = narrowed(self.config, [zone for zone, owner in self.owners().items() if owner == shard])
        names = {name: getattr(table, "client_id", None) for name, table in config.sources.items()}
        sources = {
            name: table.model_copy(update={"client_id": f"{names[name]}-{shard}"}) if names[name] else table
            for name, table in config.sources.items()
        }
        return config.model_copy(update={"sources": sources})


def shard_names(count: int) -> tuple[str, ...]:
    return tuple(f"shard-{number}" for number in range(count))
