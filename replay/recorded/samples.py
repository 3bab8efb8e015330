"""The samples of recorded sources, zone by zone, as the daemon's own alignment makes them."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from math import inf
from typing import NamedTuple

from tqdm import tqdm

from service.config.fitting import make_alignment
from service.config.recording import recorded
from service.config.site import Config, ZoneConfig
from service.records.sample import Sample

SLOW = 2.0
"""s after which a command shows how far it is."""


class Recorded(NamedTuple):
    """The samples of a zone, complete or not, and its refused readings by kind."""

    samples: list[Sample]
    refused: Mapping[str, int]

    @property
    def said(self) -> str:
        """What was refused, in words; empty where nothing was."""
        counts = ", ".join(f"{count} {fault}" for fault, count in self.refused.items())
        return f"; refused: {counts}" if counts else ""


def read_samples(
    config: Config,
    zones: Sequence[ZoneConfig],
    start: float | None = None,
    end: float | None = None,
    *,
    progress: bool | None = False,
) -> dict[str, Recorded]:
    """What the recordings of `config` hold of each of `zones` from UTC time `start` up to `end`.

    With `progress` (None: on a terminal) it is shown how far reading is. Raises ServiceError where a source is live or
    cannot be read.
    """
    return asyncio.run(_read(config, zones, start, end, progress))


async def _read(
    config: Config, zones: Sequence[ZoneConfig], start: float | None, end: float | None, progress: bool | None
) -> dict[str, Recorded]:
    alignments = {zone.id: make_alignment(zone) for zone in zones}
    samples: dict[str, list[Sample]] = {zone.id: [] for zone in zones}
    shown = None if progress is None else not progress
    with tqdm(unit=" samples", delay=SLOW, desc="reading", disable=shown) as bar:
        async for part in recorded(config, alignments, start, end):
            if part.zone in alignments:
                alignment, ended = alignments[part.zone], part.now == inf
                found = alignment.end(part.source) if ended else alignment.add(part.source, part.readings, part.now)
                bar.update(len(found))
                samples[part.zone] += [
                    sample
                    for sample in found
                    if (start is None or sample.time >= start) and (end is None or sample.time < end)
                ]
    return {
        name: Recorded(samples[name], {str(fault): count for fault, count in alignment.faults.items()})
        for name, alignment in alignments.items()
    }
