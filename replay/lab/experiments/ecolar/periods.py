"""Ecolar's periods for the topology experiment: logs in its raw layout, or synthetic stand-ins for them."""

from __future__ import annotations

import csv
import tempfile
from pathlib import Path
from typing import Literal

import numpy as np

from estimator.arrays import Array
from replay.errors import ReplayError
from replay.experiments.progress import steps
from replay.experiments.request import Request, names_of
from replay.experiments.series.recorded_zone import ZoneRecord, read_zone
from replay.experiments.topology.candidates import SOLAR, ecolar_candidates
from replay.experiments.topology.data import Recording
from replay.lab.experiments.ecolar.experiment import configuration
from replay.localtime import midnight
from replay.simulated import ecolar
from replay.simulated.semi_synthetic import PERIOD as WEATHER_PERIOD
from replay.simulated.semi_synthetic import WEATHER_COLUMNS, read_weather
from replay.simulated.weather import KONSTANZ, weather

STANDIN_SEEDS = (2,)
PERIODS: tuple[Literal["spring", "autumn"], ...] = ("spring", "autumn")


def periods(request: Request) -> list[Recording]:
    """The logs of --data, or both stand-ins for each seed; ReplayError where a log cannot be used."""
    if request.data:
        return _of_logs(request.data)
    wanted = [(period, seed) for seed in request.seeds or STANDIN_SEEDS for period in PERIODS]
    return [_standin(period, seed) for period, seed in steps(wanted, "simulating")]


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
    config = configuration(path)
    return read_zone(config, config.zones[0])


def _with_sun(record: ZoneRecord, irradiance: Array) -> ZoneRecord:
    return record._replace(columns={**record.columns, SOLAR: irradiance})
