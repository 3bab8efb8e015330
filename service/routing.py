"""Splitting what one source delivers over the zones it feeds."""

from __future__ import annotations

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
        """`channels`: every channel id that the source delivers."""
        self.source = source
        self._zone_of = {channel: channel.split("/", 1)[0] for channel in channels}
        self.zones = tuple(dict.fromkeys(self._zone_of.values()))

    def split(self, batch: Batch) -> list[Delivery]:
        """One delivery for every zone of the source, also without readings: the clock concerns them all.

        Raises KeyError for a channel id that was not announced.
        """
        if len(self.zones) == 1:
            return [Delivery(self.zones[0], self.source, batch.readings, batch.now)]
        shares: dict[str, list[Reading]] = {zone: [] for zone in self.zones}
        for reading in batch.readings:
            shares[self._zone_of[reading.channel]].append(reading)
        return [Delivery(zone, self.source, readings, batch.now) for zone, readings in shares.items()]
