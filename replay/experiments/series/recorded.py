"""A recorded zone as a series of complete samples, through the alignment that the daemon uses."""

from __future__ import annotations

import asyncio

import numpy as np

from replay.errors import ReplayError
from replay.experiments.series.filtering import Series
from service.config.fitting import make_alignment
from service.config.recording import recorded
from service.config.site import Config, ZoneConfig
from service.records.sample import Sample


def series_of(config: Config, zone: ZoneConfig, days: int | None = None) -> Series:
    """The samples of `zone` that lack no output and no input, the first `days` of them if given.

    A sample after a gap starts a segment. Raises ReplayError where nothing is left, ServiceError where a recording
    cannot be read.
    """
    samples = [sample for sample in asyncio.run(samples_of(config, zone)) if _complete(sample)]
    if days is not None and samples:
        samples = [sample for sample in samples if sample.time < samples[0].time + days * 86_400]
    if len(samples) < 2:
        raise ReplayError(
            f"zone '{zone.id}': {len(samples)} complete samples in the recording; an experiment needs every output and "
            "input of the network at once"
        )
    times = np.array([sample.time for sample in samples], dtype=np.int64)
    return Series(
        times,
        np.array([sample.outputs for sample in samples]),
        np.array([sample.inputs for sample in samples]),
        np.concatenate([[True], np.diff(times) != zone.period]),
    )


async def samples_of(config: Config, zone: ZoneConfig) -> list[Sample]:
    """Every sample of `zone`, complete or not; ServiceError where a recording cannot be read."""
    alignment, samples = make_alignment(zone), []
    async for part in recorded(config, [zone.id], None, None):
        if part.zone == zone.id:
            samples += (
                alignment.end(part.source) if part.now is None else alignment.add(part.source, part.readings, part.now)
            )
    return samples


def _complete(sample: Sample) -> bool:
    return bool(np.isfinite(sample.outputs).all() and np.isfinite(sample.inputs).all())
