"""The samples of recorded sources, zone by zone, as the daemon's own alignment makes them."""

import asyncio
from collections import Counter
from collections.abc import Mapping, Sequence
from math import inf
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from service.config.fitting import make_alignment
from service.config.site import Config, ZoneConfig
from service.recordings.merged import recorded
from service.recordings.progress import Progress
from service.records.sample import Sample


class Recorded(NamedTuple):
    """The samples of a zone, complete or not, in order; how many readings they come from, and those refused by kind."""

    samples: Sequence[Sample]
    refused: Mapping[str, int]
    readings: int

    @property
    def said(self) -> str:
        """What was refused, in words; empty where nothing was."""
        counts = ", ".join(f"{count} {fault}" for fault, count in self.refused.items())
        return f"; refused: {counts}" if counts else ""

    @property
    def times(self) -> Array:
        """(L,) UTC s of the samples."""
        return np.array([sample.time for sample in self.samples], dtype=np.float64)

    @property
    def values(self) -> Array:
        """(L, n): channels in the network's order and unit, NaN where nothing was measured."""
        return np.array([np.concatenate([sample.outputs, sample.inputs]) for sample in self.samples])


def read_samples(
    config: Config,
    zones: Sequence[ZoneConfig],
    start: float | None = None,
    end: float | None = None,
    *,
    most: float = inf,
    progress: bool | None = False,
) -> dict[str, Recorded]:
    """What the recordings of `config` hold of each of `zones` from UTC time `start` up to `end`, but not more than
    about `most` s of it.

    With `progress` (None: on a terminal) it is shown how far reading is. Raises ServiceError where a source is live or
    cannot be read.
    """
    alignments = {zone.id: make_alignment(zone) for zone in zones}
    samples: dict[str, list[Sample]] = {zone.id: [] for zone in zones}
    readings: Counter[str] = Counter()

    async def read() -> None:
        first = inf
        with Progress("reading", None, progress) as bar:
            async for part in recorded(config, alignments, start, end):
                if part.zone in alignments:
                    alignment, ended = alignments[part.zone], part.now == inf
                    found = alignment.end(part.source) if ended else alignment.add(part.source, part.readings, part.now)
                    readings[part.zone] += len(part.readings)
                    bar.update(len(found))
                    samples[part.zone] += [
                        sample
                        for sample in found
                        if (start is None or sample.time >= start) and (end is None or sample.time < end)
                    ]
                    first = min([first, *(sample.time for sample in found[:1])])
                    if first + most < part.now < inf:
                        break

    asyncio.run(read())
    return {
        name: Recorded(samples[name], {str(fault): count for fault, count in alignment.faults.items()}, readings[name])
        for name, alignment in alignments.items()
    }
