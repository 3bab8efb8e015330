"""The recordings that candidates are fitted to: the user's own zone, or what the laboratory has of Ecolar Home."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adapters.csv.config import CsvConfig
from replay.experiments.catalogue import laboratory
from replay.experiments.request import Request
from replay.experiments.series.chosen import chosen
from replay.experiments.series.recorded_zone import ZoneRecord, live_zone, read_zone
from replay.experiments.topology.candidates import Candidate, candidates_for
from replay.experiments.topology.toml import Place
from replay.localtime import DAY
from replay.scores.windows import Window
from service.config.site import Config, ZoneConfig


class Recording(NamedTuple):
    """A recording and the networks to fit to it."""

    name: str
    what: str
    """What it is, in a sentence."""
    record: ZoneRecord
    candidates: list[Candidate]
    time_zone: str
    """IANA name of the local time that night and day go by."""
    place: Place | None = None
    """Where the network that is found belongs; None for a stand-in for Ecolar Home."""

    def first_days(self, days: int) -> Recording:
        """The first `days` of it."""
        record = self.record
        kept = int(np.searchsorted(record.times, record.times[0] + days * DAY))
        return self._replace(record=record.rows(Window(0, kept)))


def recordings(request: Request) -> list[Recording]:
    """What `request` asks for: the zone of --config or --state, or both Ecolar stand-ins."""
    if request.configuration is not None:
        found = [_of_zone(request)]
    else:
        ecolar = laboratory("replay.lab.experiments.ecolar.standins", "experiment topology without --config or --state")
        found = ecolar.standins(request.seeds)
    return found if request.days is None else [recording.first_days(request.days) for recording in found]


def _of_zone(request: Request) -> Recording:
    path, live = request.configuration, request.state
    assert path is not None
    config, table = chosen(request)
    return Recording(
        table.id,
        f"zone `{table.id}` of `{path.name}`, as its recorded sources have it"
        if live is None
        else f"zone `{table.id}`, as the daemon on `{live}` has accepted its samples",
        read_zone(config, table) if live is None else live_zone(live, table),
        candidates_for(table.network),
        table.whereabouts.time_zone or _clock_of(config, table) or "UTC",
        Place(path, request.overrides, table.id, running=request.config is None),
    )


def _clock_of(config: Config, table: ZoneConfig) -> str | None:
    """The time zone that the recording of the measured node is written in, if it says."""
    source = config.sources[table.channels[table.network.measured[0]].source]
    return source.timestamp.zone if isinstance(source, CsvConfig) else None
