"""What a recording holds of each zone, and what looks wrong with it."""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import numpy as np

from adapters.fields.durations import DAY, format_duration
from adapters.fields.times import written_time
from service.config.site import Config, ZoneConfig
from service.recordings.doubts import doubts
from service.recordings.samples import Recorded, read_samples


class History(NamedTuple):
    """What a recording holds of one zone, by the zone's own grid."""

    zone: str
    recorded: Recorded
    measured: float
    """Share of the samples in which the zone's first output was measured."""
    complete: float
    """Share of the samples in which every input was measured."""
    longest_gap: int
    """s without a measured output at most, within the history."""
    doubts: Sequence[str]
    """What looks wrong with it, one sentence each."""

    @property
    def described(self) -> str:
        """One line about the history."""
        samples, said = self.recorded.samples, self.recorded.said
        if not samples:
            return f"zone '{self.zone}': nothing usable{said}"
        first, last = samples[0].time, samples[-1].time
        gap = f"longest gap {format_duration(self.longest_gap)}" if self.longest_gap else "no gap"
        return (
            f"zone '{self.zone}': {len(samples)} samples from {written_time(first)} to {written_time(last)} "
            f"({(last - first) / DAY:.1f} days), measured in {100 * self.measured:.0f} %, every input in "
            f"{100 * self.complete:.0f} %, {gap}{said}"
        )


def survey(
    config: Config,
    zones: Sequence[ZoneConfig],
    start: float | None = None,
    end: float | None = None,
    *,
    most: float = inf,
) -> dict[str, History]:
    """What the recordings of `config` hold of each of `zones`; arguments and errors are those of `read_samples`."""
    found = read_samples(config, zones, start, end, most=most, progress=None)
    return {zone.id: _history(zone, found[zone.id]) for zone in zones}


def _history(zone: ZoneConfig, found: Recorded) -> History:
    told = doubts(zone, found)
    outputs = len(zone.network.measured)
    known = np.isfinite(found.values)
    if not found.samples or not known[:, :outputs].any():
        # Without the room there is nothing to learn, and what is taken into the state would stay there.
        return History(zone.id, found._replace(samples=()), 0.0, 0.0, 0, told)
    return History(
        zone.id,
        found,
        measured=float(known[:, 0].mean()),
        complete=float(known[:, outputs:].all(axis=1).mean()),
        longest_gap=int(np.diff(found.times[known[:, 0]]).max(initial=zone.period) - zone.period),
        doubts=told,
    )
