"""Splitting what one source delivers over the zones it feeds."""

from collections.abc import Iterable
from typing import NamedTuple

from adapters.reading import Batch, Reading


class Delivery(NamedTuple):
    """A zone's share of a batch: what `Alignment.add` takes. `readings` is empty where the batch had none for it."""

    zone: str
    source: str
    readings: list[Reading]
    now: float


class Router:
    """Splits the batches of `source`, once each, by the zone in the channel ids "zone/channel"."""

    def __init__(self, source: str, channels: Iterable[str]) -> None:
        self.source = source
        self.zones: tuple[str, ...] = ()
        self._zone_of: dict[str, str] = {}
        self.adopt(channels)

    def adopt(self, channels: Iterable[str]) -> None:
        """From now on the source delivers `channels`; what it still brings of others is nobody's."""
        told = {channel: channel.split("/", 1)[0] for channel in channels}
        self._zone_of |= told
        self.keep(told.values())

    def keep(self, zones: Iterable[str]) -> None:
        """Only these zones get a share from now on."""
        self.zones = tuple(dict.fromkeys(zones))
        self._alone = set(self._zone_of.values()) == set(self.zones) and len(self.zones) == 1

    def split(self, batch: Batch) -> list[Delivery]:
        """One delivery for every zone of the source, also without readings: the clock concerns them all.

        Raises KeyError for a channel id that was never announced.
        """
        if self._alone:
            return [Delivery(self.zones[0], self.source, batch.readings, batch.now)]
        shares: dict[str, list[Reading]] = {zone: [] for zone in self.zones}
        nobody: list[Reading] = []
        for reading in batch.readings:
            shares.get(self._zone_of[reading.channel], nobody).append(reading)
        return [Delivery(zone, self.source, readings, batch.now) for zone, readings in shares.items()]
