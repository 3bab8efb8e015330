"""Which shard runs which zone: rendezvous hashing (Thaler and Ravishankar, 1998).

Every zone goes to the shard with the greatest weight of the pair. A shard that is added takes its share from all the
others, one that is removed leaves its zones to them, and no other zone moves.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Hashes = npt.NDArray[np.uint64]

_ROWS = 4096
"""Zones whose weights are in memory at a time."""


def owners(zones: Sequence[str], shards: Sequence[str]) -> dict[str, str]:
    """The shard of every zone, one of `shards`, of which there must be one at least; the same on every machine."""
    columns = _hashes(shards)
    found: dict[str, str] = {}
    for first in range(0, len(zones), _ROWS):
        some = zones[first : first + _ROWS]
        best = np.argmax(_mixed(_hashes(some)[:, None] ^ columns[None, :]), axis=1)
        found |= {zone: shards[column] for zone, column in zip(some, best.tolist(), strict=True)}
    return found


def _hashes(names: Sequence[str]) -> Hashes:
    """64 bits of each name (n,)."""
    digests = b"".join(hashlib.blake2b(name.encode(), digest_size=8).digest() for name in names)
    return np.frombuffer(digests, dtype="<u8").astype(np.uint64)


def _mixed(values: Hashes) -> Hashes:
    """The finalizer of SplitMix64 (Steele, Lea and Flood, 2014): every bit of the input moves half of the output's."""
    values = (values ^ (values >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    values = (values ^ (values >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return values ^ (values >> np.uint64(31))
