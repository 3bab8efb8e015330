"""The recordings that candidates are fitted to: the user's own zone, or what the laboratory has of Ecolar Home."""

from typing import NamedTuple

from adapters.csv.config import CsvConfig
from replay.errors import ReplayError
from replay.experiments.catalogue import laboratory
from replay.experiments.request import Request, chosen
from replay.experiments.series.recorded_zone import ZoneRecord, live_zone, pieces, read_zone
from replay.experiments.topology.candidates import Candidate, candidates_for
from replay.experiments.topology.fit import SHORTEST
from replay.experiments.topology.toml import Place
from replay.localtime import HOUR
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

    @property
    def windows(self) -> list[Window]:
        """Where every candidate can be fitted: the same rows for all of them. ReplayError where there are none."""
        output = self.candidates[0].network.measured[0]
        outputs = {node for candidate in self.candidates for node in candidate.network.measured}
        inputs = [channel for channel in self.record.columns if channel not in outputs]
        found = pieces(self.record, output, inputs, SHORTEST)
        if not found:
            raise ReplayError(
                f"{self.name}: no {SHORTEST // HOUR} h of the recording have all of {', '.join(inputs)} without a "
                "gap; a longer recording is needed, or larger hold_inputs in its zone"
            )
        return found


def recordings(request: Request) -> list[Recording]:
    """What `request` asks for: the zone of --config or --state, or both Ecolar stand-ins."""
    if request.configuration is not None:
        found = [_of_zone(request)]
    else:
        ecolar = laboratory("replay.lab.experiments.ecolar.standins", "experiment topology without --config or --state")
        found = ecolar.standins(request.seeds)
    return [one._replace(record=one.record.first_days(request.days)) for one in found]


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
