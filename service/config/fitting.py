"""What a zone's configuration amounts to: its worker, its alignment, and the fingerprint of its state.

The daemon and `thermogate replay` both build their zones here, so that a recorded period runs through the same code.
"""

from __future__ import annotations

from math import ceil

from adapters.timestamps import EARLIEST
from estimator import registry
from service.config.site import ZoneConfig
from service.zone import snapshot
from service.zone.alignment import Alignment
from service.zone.clock import PLAUSIBLE
from service.zone.worker import WorkerSettings, ZoneWorker

_MOST_EMPTY = 1000
"""Empty samples in a row at most, so that a clock set forward by years brings a moment's work. A worker that bridges
more makes up for them when telemetry comes again."""


def make_worker(zone: ZoneConfig) -> ZoneWorker:
    """A fresh worker of `zone`."""
    estimator = registry.construct(zone.estimator, zone.network, zone.period, zone.options)
    return ZoneWorker(estimator, WorkerSettings(zone.seed, zone.levels, zone.max_gap, zone.hold_inputs, zone.max_ages))


def make_alignment(
    zone: ZoneConfig, resume_after: int | None = None, live: bool = False, resume_idle: int = 0
) -> Alignment:
    """The alignment of `zone`, `live` or recorded, going on after the sample at `resume_after` if there is one, with
    which `resume_idle` samples in a row without a reading ended."""
    # A worker stalls once neither prediction nor held inputs bridge the silence; empty samples beyond that say nothing.
    longest = max(zone.hold_inputs, *zone.max_ages.values(), 0.0)
    bridged = min(max(zone.max_gap, ceil(longest / zone.period)) + 1, _MOST_EMPTY)
    return Alignment(
        zone.network,
        zone.period,
        {channel: table.aggregate for channel, table in zone.channels.items()},
        sources={table.source for table in zone.channels.values()},
        zone=zone.id,
        lateness=zone.lateness,
        idle_limit=bridged,
        resume_after=resume_after,
        resume_idle=resume_idle,
        live=live,
        # Nothing that is dated by a clock that was never set is believed.
        earliest=PLAUSIBLE if live else EARLIEST,
    )


def fingerprint(zone: ZoneConfig) -> str:
    """What a stored state of `zone` belongs to."""
    structure = registry.structure(zone.estimator, zone.options)
    return snapshot.fingerprint(zone.network, zone.period, zone.estimator, structure)
