"""The recordings that candidates are fitted to: Ecolar stand-ins, an Ecolar log, or the user's own zone."""

from __future__ import annotations

import csv
import tempfile
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from replay.errors import ReplayError
from replay.experiments.ecolar.experiment import configuration
from replay.experiments.progress import steps
from replay.experiments.request import Request, names_of
from replay.experiments.series.networks import network_of, zone_of
from replay.experiments.series.recorded_zone import ZoneRecord, live_zone, read_zone
from replay.experiments.topology.candidates import OWN, SOLAR, Candidate, candidates_for, ecolar_candidates
from replay.experiments.topology.toml import Place
from replay.localtime import DAY, midnight
from replay.simulated import ecolar
from replay.simulated.semi_synthetic import PERIOD as WEATHER_PERIOD
from replay.simulated.semi_synthetic import WEATHER_COLUMNS, read_weather
from replay.simulated.weather import KONSTANZ, weather
from service.config.load import load
from service.config.site import Config, ZoneConfig
from service.sources.csv import CsvConfig

STANDIN_SEEDS = (2,)
PERIODS: tuple[Literal["spring", "autumn"], ...] = ("spring", "autumn")


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
    elif request.data:
        found = _of_logs(request.data)
    else:
        wanted = [(period, seed) for seed in request.seeds or STANDIN_SEEDS for period in PERIODS]
        found = [_standin(period, seed) for period, seed in steps(wanted, "simulating")]
    if request.network is not None and request.configuration is None:
        found = [_with_own(item, network_of(request, request.network)) for item in found]
    if request.days is None:
        return found
    return [item._replace(record=_first_days(item.record, request.days)) for item in found]


def _of_zone(request: Request) -> Recording:
    path, live = request.configuration, request.state
    if path is None:
        raise ValueError("a zone needs a configuration")
    table, config = zone_of(request), load(path, request.overrides)
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


def _of_logs(files: tuple[Path, ...]) -> list[Recording]:
    """Ecolar logs; a file with the columns of a weather file brings irradiance for all of them."""
    skies = [path for path in files if _is_weather(path)]
    logs = [path for path in files if path not in skies]
    if not logs or len(skies) > 1:
        raise ReplayError(
            f"--data brought {len(logs)} Ecolar logs and {len(skies)} weather files; give one log or more "
            f"({', '.join(ecolar.COLUMNS[:4])}, ...) and at most one weather file ({', '.join(WEATHER_COLUMNS)})"
        )
    found = []
    for name, path in zip(names_of(logs), logs, strict=True):
        record = _read_log(path)
        if skies:
            times, sky = read_weather(skies[0])
            irradiance = np.interp(
                record.times + record.period / 2, times + WEATHER_PERIOD / 2, sky.irradiance, np.nan, np.nan
            )
            record = _with_sun(record, irradiance)
        what = f"the log `{path.name}`" + (f", with the irradiance of `{skies[0].name}`" if skies else "")
        found.append(Recording(name, what, record, ecolar_candidates(bool(skies)), ecolar.ZONE, None))
    return found


def _is_weather(path: Path) -> bool:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return set(WEATHER_COLUMNS) <= set(next(csv.reader(file), []))
    except (OSError, UnicodeDecodeError):
        return False


def _standin(period: Literal["spring", "autumn"], seed: int) -> Recording:
    """A simulated Ecolar period, read back from a file as a real one would be, with the irradiance that drove it."""
    start, end = (midnight(*day, ecolar.ZONE) for day in ecolar.PERIODS[period])
    with tempfile.TemporaryDirectory(prefix="thermogate-topology-") as folder:
        path = ecolar.write_standin(Path(folder) / "ecolar-SYNTHETIC.csv", period, seed)
        record = _read_log(path)
    minutes = np.arange(start, end, ecolar.GRID_STEP)
    sky = weather(minutes, KONSTANZ, seed).irradiance
    irradiance = np.interp(record.times + record.period / 2, minutes, sky)
    return Recording(
        f"{period}-seed{seed}",
        f"a simulated stand-in for the unpublished {period} recording of Ecolar Home (seed {seed})",
        _with_sun(record, irradiance),
        ecolar_candidates(True),
        ecolar.ZONE,
        None,
        synthetic=True,
    )


def _read_log(path: Path) -> ZoneRecord:
    """An Ecolar log on the grid, preprocessed as in the paper."""
    with tempfile.TemporaryDirectory(prefix="thermogate-topology-") as folder:
        config = configuration(path.resolve(), Path(folder))
        return read_zone(config, config.zones[0])


def _with_sun(record: ZoneRecord, irradiance: Array) -> ZoneRecord:
    return record._replace(columns={**record.columns, SOLAR: irradiance})


def _first_days(record: ZoneRecord, days: int) -> ZoneRecord:
    kept = int(np.searchsorted(record.times, record.times[0] + days * DAY))
    return ZoneRecord(
        record.times[:kept], record.period, {name: values[:kept] for name, values in record.columns.items()}
    )
