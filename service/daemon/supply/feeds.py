"""Sources at work: for each, the task that delivers what it brings, and what is counted of it."""

import asyncio
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from math import inf

from adapters.http.posted import Posted
from adapters.http.source import HttpSource
from adapters.reading import Batch
from adapters.routing import Router
from service.config.site import Config
from service.daemon.supply.feeding import Tally, feed
from service.daemon.tasks import end
from service.records.receipt import NOTHING, Receipt
from service.zone.zone import Zone

NO_SOURCE = 'no zone has a source that is posted to; add one with kind = "http", and channels that name it'


class Feed:
    """One source delivering to some zones."""

    def __init__(
        self,
        name: str,
        config: Config,
        zones: Mapping[str, Zone],
        served: Collection[str],
        tally: Tally,
    ) -> None:
        """`served` are the zones of `config` that it is for; `zones` finds them when something comes for them."""
        self.name = name
        self.tally = tally
        self._zones = zones
        self._config = narrowed(config, served)
        self.source = self._config.build_source(name)
        self._router = Router(name, _channels(name, self._config))
        self._task: asyncio.Task[None] | None = None

    @property
    def served(self) -> tuple[str, ...]:
        return self._router.zones

    @property
    def is_posted_to(self) -> bool:
        """Whether clients hand its readings over (`receive`)."""
        return isinstance(self.source, HttpSource)

    def asking(self, posted: Posted, zone: str | None) -> int:
        """How many channels, of `zone` if one is given, ask for a value that was posted."""
        return len(self.source.zones_of(posted, zone)) if isinstance(self.source, HttpSource) else 0

    async def receive(self, posted: Sequence[Posted], zone: str | None) -> Receipt:
        """Hand what was posted to the zones, or to `zone` alone; what is accepted is durable on return. Raises
        ServiceError; whoever posts the same again gets the same."""
        assert isinstance(self.source, HttpSource)
        received = self.source.receive(posted, zone)
        self.tally.readings += len(received.readings)
        shares = [
            share
            for share in self._router.split(Batch(received.readings, -inf))
            if share.readings and share.zone in self._zones
        ]
        taking = (self._zones[share.zone].intake.take(self.name, share.readings) for share in shares)
        results = await asyncio.gather(*taking, return_exceptions=True)
        receipt, failed = replace(NOTHING, begun=received.begun), list[BaseException]()
        for share, result in zip(shares, results, strict=True):
            if isinstance(result, BaseException):
                received.take_back(share.zone)
                failed.append(result)
            else:
                receipt = receipt.plus(result)
        if failed:
            raise failed[0]
        return receipt

    @property
    def over(self) -> bool:
        """Whether it has come to its end, or given up."""
        return self._task is not None and self._task.done()

    def start(self, position: float | None) -> None:
        """Begin to deliver, a recording from UTC time `position` on (None: its beginning)."""
        self._task = asyncio.create_task(self._run(position), name=f"source {self.name}")

    def leave(self, zones: Collection[str]) -> None:
        """Deliver nothing to `zones` any more."""
        self._router.keep(zone for zone in self._router.zones if zone not in zones)

    def rebind(self, config: Config, served: Collection[str]) -> None:
        """Deliver to the zones `served` of `config` from now on, over the same connection. Live sources only."""
        new = narrowed(config, served)
        if new.bindings(self.name) != self._config.bindings(self.name):
            new.rebind_source(self.name, self.source)
        self._config = new
        self._router.adopt(_channels(self.name, new))

    async def stop(self) -> None:
        """Stop delivering and release what the source holds."""
        if self._task is not None:
            await end([self._task])

    async def _run(self, position: float | None) -> None:
        try:
            await feed(self.source, self._router, self._zones, position, self.tally)
        finally:
            self.tally.delivers = False
            await self.source.close()


def narrowed(config: Config, served: Collection[str]) -> Config:
    """`config` with the zones `served` alone."""
    wanted = set(served)
    return config.model_copy(update={"zones": tuple(zone for zone in config.zones if zone.id in wanted)})


def _channels(source: str, config: Config) -> list[str]:
    """Ids "zone/channel" of the readings that `source` delivers."""
    return [binding.id for binding in config.bindings(source)]
