"""The metrics of a whole fleet in one exposition: those of every shard, with its name as a label."""

import asyncio
from collections.abc import Callable, Iterable, Mapping, Sequence

from prometheus_client import Metric
from prometheus_client.registry import Collector

from service.errors import ServiceError
from service.fleet.peers import Peer

SCRAPE_SECONDS = 8.0
"""How long the shards may take; one that takes longer is left out, and `thermogate_shard_up` says so."""
_BEGUN = "_created"


class FleetCollector(Collector):
    """Asks the shards at every scrape, which comes on a thread of its own."""

    def __init__(self, loop: asyncio.AbstractEventLoop, shards: Callable[[], Sequence[Peer]]) -> None:
        self._loop, self._shards = loop, shards

    def collect(self) -> Iterable[Metric]:
        shards = list(self._shards())
        answers = asyncio.run_coroutine_threadsafe(_asked(shards), self._loop).result()
        up = Metric("thermogate_shard_up", "1 while the shard answers", "gauge")
        for shard in shards:
            up.add_sample(up.name, {"shard": shard.name}, float(shard.name in answers))
        return [up, *merged(answers)]

    def describe(self) -> Iterable[Metric]:
        """Nothing: asking the shards is for scrapes, not for registration."""
        return ()


async def _asked(shards: Sequence[Peer]) -> dict[str, list[Metric]]:
    async def one(shard: Peer) -> list[Metric] | None:
        try:
            metrics: list[Metric] = await shard.ask("metrics", timeout=SCRAPE_SECONDS)
        except ServiceError:
            return None
        return metrics

    found = await asyncio.gather(*(one(shard) for shard in shards))
    return {shard.name: metrics for shard, metrics in zip(shards, found, strict=True) if metrics is not None}


def merged(answers: Mapping[str, Sequence[Metric]]) -> list[Metric]:
    """One family of each name, with the samples of every shard."""
    families: dict[str, Metric] = {}
    for shard, metrics in answers.items():
        for metric in metrics:
            family = families.setdefault(metric.name, Metric(metric.name, metric.documentation, metric.type))
            for sample in metric.samples:
                if not sample.name.endswith(_BEGUN):
                    family.samples.append(sample._replace(labels={"shard": shard, **sample.labels}))
    return list(families.values())
