"""The recordings that forecasts are made for: that of the user's own zone, or what the laboratory has at hand."""

from __future__ import annotations

from typing import NamedTuple

from estimator.arrays import Array
from estimator.network.network import Network
from replay.errors import ReplayError
from replay.experiments.catalogue import laboratory
from replay.experiments.request import Request, chosen
from replay.experiments.series.filtering import Series
from replay.experiments.series.recorded_zone import ZoneRecord, bridged, read_zone
from replay.localtime import DAY
from service.config.site import Config, Whereabouts, ZoneConfig


class Known(NamedTuple):
    """What only a simulator knows of a room: the unmeasured heat without the sun (K,) [W], the mean over the step that
    ends at each row, and the heat loss to outdoors [W/K]."""

    gain: Array
    heat_loss: float


class Recording(NamedTuple):
    """A recording every `period` s and a network for it; `what` says in a phrase where it comes from."""

    name: str
    what: str
    measured: bool
    """Whether it comes from a real room."""
    network: Network
    period: int
    series: Series
    known: Known | None = None
    """None where nobody knows."""
    whereabouts: Whereabouts = Whereabouts()

    def first_days(self, days: int) -> Recording:
        first = self.series.times < self.series.times[0] + days * DAY
        known = self.known and Known(self.known.gain[first], self.known.heat_loss)
        return self._replace(series=self.series.rows(first), known=known)


def recordings(request: Request) -> list[Recording]:
    """The zone of --config, or what the laboratory has at hand, or --recording of it; ReplayError if there is none."""
    if request.config is not None:
        found = [of_zone(*chosen(request))]
    else:
        benchmark = laboratory("replay.lab.experiments.recordings", "experiment hours-ahead without --config")
        found = benchmark.at_hand(request.file, request.recording)
    return found if request.days is None else [recording.first_days(request.days) for recording in found]


def of_zone(config: Config, zone: ZoneConfig) -> Recording:
    """The recording of a zone, bridged as the daemon would bridge it."""
    return of_record(read_zone(config, zone), zone)


def of_record(record: ZoneRecord, zone: ZoneConfig) -> Recording:
    series = bridged(record, zone.network, zone.max_gap)
    if len(series.times) < 2:
        raise ReplayError(f"zone '{zone.id}': the recording has no two usable samples in a row; check its channels")
    what = f"the recording of the zone '{zone.id}' with its own network"
    return Recording(zone.id, what, True, zone.network, int(zone.period), series, whereabouts=zone.whereabouts)
