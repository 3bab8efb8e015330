"""Which shard runs which zone: rendezvous hashing (Thaler and Ravishankar, 1998) of what the zone reads from.

Zones that read from one device stay together, so that one process polls it. Every other zone goes by its own id: any
number of processes may read a file, ask a server or subscribe. Each group goes to the shard with the greatest weight of
the pair. A shard that is added takes its share from all the others, one that is removed leaves its zones to them, and
no other zone moves.
"""

import hashlib
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from service.config.site import Config

Hashes = npt.NDArray[np.uint64]

_POLLED = ("modbus", "bacnet", "opcua")
"""Kinds of sources whose devices bear one process that polls them."""
_FAR_MORE = 1.5


def keys(config: Config) -> dict[str, str]:
    """What decides over the shard of each zone: the first device, by name, that it and others read from, or itself."""
    first: dict[str, str] = {}

    def root(name: str) -> str:
        while first.setdefault(name, name) != name:
            name = first[name]
        return name

    alone = {name for name, table in config.sources.items() if _is_for_one_process(table)}
    devices = {zone.id: sorted(alone & {table.source for table in zone.delivered.values()}) for zone in config.zones}
    for names in devices.values():
        roots = sorted(map(root, names))
        first.update(dict.fromkeys(roots, roots[0]) if roots else {})
    return {zone: f"source/{root(names[0])}" if names else zone for zone, names in devices.items()}


def lopsided(config: Config, shards: int) -> list[str]:
    """A sentence where so many zones hang together that one shard has far more than its share."""
    (key, most), *_ = Counter(keys(config).values()).most_common(1)
    if most == 1 or most * shards <= _FAR_MORE * len(config.zones):
        return []
    source = key.replace("/", "s.")
    return [
        f"{most} of {len(config.zones)} zones are run by one of {shards} shards, which polls {source} for all of them; "
        "a device that zones of several others read, such as an outdoor sensor, may have a [sources] table for each of "
        "those, if it bears so many connections"
    ]


def _is_for_one_process(table: Any) -> bool:
    """Whether only one process may read a source: it is polled, or listens at an address of its own."""
    return table.kind in _POLLED or bool(getattr(table, "listen", ()))


def owners(zones: Sequence[str], shards: Sequence[str]) -> dict[str, str]:
    """The shard of every zone, one of `shards`, of which there must be one at least; the same on every machine."""
    columns = _hashes(shards)
    return {
        zone: shards[int(np.argmax(_mixed(own ^ columns)))] for zone, own in zip(zones, _hashes(zones), strict=True)
    }


def _hashes(names: Sequence[str]) -> Hashes:
    """64 bits of each name (n,)."""
    digests = b"".join(hashlib.blake2b(name.encode(), digest_size=8).digest() for name in names)
    return np.frombuffer(digests, dtype="<u8").astype(np.uint64)


def _mixed(values: Hashes) -> Hashes:
    """The finalizer of SplitMix64 (Steele, Lea and Flood, 2014): every bit of the input moves half of the output's."""
    values = (values ^ (values >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    values = (values ^ (values >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return values ^ (values >> np.uint64(31))
