"""The recordings that candidates are fitted to: the user's own zone, or what the laboratory has of Ecolar Home."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adapters.csv.config import CsvConfig
from estimator.network.network import Network
from replay.errors import ReplayError
from replay.experiments.checkout import laboratory
from replay.experiments.request import Request
from replay.experiments.series.networks import chosen, network_of
from replay.experiments.series.recorded_zone import ZoneRecord, live_zone, read_zone
from replay.experiments.topology.candidates import OWN, Candidate, candidates_for
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
    place: Place | None
    """Where the network that is found belongs; None for Ecolar."""
    synthetic: bool = False


def recordings(request: Request) -> list[Recording]:
    """What `request` asks for: the zone of --config or --state, the Ecolar logs of --data, or both Ecolar stand-ins."""
    if request.configuration is not None:
        if request.data:
            other = "--config names recordings" if request.state is None else "--state has samples"
            raise ReplayError(f"--data is an Ecolar log, and {other} of its own; give one of the two")
        found = [_of_zone(request)]
    else:
        found = laboratory("experiments.ecolar.periods", "experiment topology without --config or --state").periods(
            request
        )
    if request.network is not None and request.configuration is None:
        found = [_with_own(item, network_of(request, request.network)) for item in found]
    if request.days is None:
        return found
    return [item._replace(record=_first_days(item.record, request.days)) for item in found]


def _of_zone(request: Request) -> Recording:
    path, live = request.configuration, request.state
    if path is None:
        raise ValueError("a zone needs a configuration")
    config, table = chosen(request)
    zone = request.time_zone or _clock_of(config, table)
    return Recording(
        table.id,
        f"zone `{table.id}` of `{path.name}`, as its recorded sources have it"
        if live is None
        else f"zone `{table.id}`, as the daemon on `{live}` has accepted its samples",
        read_zone(config, table) if live is None else live_zone(live, table),
        candidates_for(table.network),
        zone or "UTC",
        Place(path, request.overrides, table.id, running=request.config is None),
    )


def _with_own(recording: Recording, own: Network) -> Recording:
    """`recording` with the network of --network among the candidates."""
    missing = [channel for channel in own.channels if channel not in recording.record.columns]
    if missing:
        raise ReplayError(
            f"--network {own.name} needs {', '.join(missing)}, which the recording {recording.name} lacks; it has "
            f"{', '.join(recording.record.columns)}"
        )
    mine = [candidate for candidate in candidates_for(own) if candidate.label == OWN]
    return recording._replace(candidates=[*mine, *recording.candidates])


def _clock_of(config: Config, table: ZoneConfig) -> str | None:
    """The time zone that the recording of the measured node is written in, if it says."""
    source = config.sources[table.channels[table.network.measured[0]].source]
    return source.timestamp.zone if isinstance(source, CsvConfig) else None


def _first_days(record: ZoneRecord, days: int) -> ZoneRecord:
    kept = int(np.searchsorted(record.times, record.times[0] + days * DAY))
    return record.rows(Window(0, kept))
