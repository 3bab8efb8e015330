"""Synthetic stand-ins for Ecolar's recordings, read back from a file as real ones would be."""

import json
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from replay.experiments.progress import steps
from replay.experiments.series.recorded_zone import read_zone
from replay.experiments.topology.candidates import SOLAR, ecolar_candidates
from replay.experiments.topology.data import Recording
from replay.lab import EXAMPLES
from replay.localtime import midnight
from replay.simulated import ecolar
from replay.simulated.ecolar import Period
from replay.simulated.weather import weather
from service.config.load import load
from service.config.site import Config, ZoneConfig

Result = TypeVar("Result")

SEED = 2
PERIODS: tuple[Period, ...] = ("spring", "autumn")


def configuration(log: Path) -> Config:
    """The example of a zone that `log`, in Ecolar's raw layout, feeds; it is preprocessed as in paper 4.3.1."""
    return load(EXAMPLES / "ecolar.toml", [f"sources.recording.files={json.dumps([str(log.resolve())])}"])


def of_standin(period: Period, read: Callable[[Config, ZoneConfig], Result], seed: int = SEED) -> Result:
    """What `read` makes of the zone whose stand-in is written for the purpose."""
    with tempfile.TemporaryDirectory(prefix="thermogate-ecolar-") as folder:
        log = ecolar.write_standin(Path(folder) / f"ecolar-{period}-SYNTHETIC.csv", period, seed)
        config = configuration(log)
        return read(config, config.zones[0])


def standins(seeds: Sequence[int]) -> list[Recording]:
    """Both periods for each seed, for the topology experiment, with the irradiance that drove them."""
    wanted = [(period, seed) for seed in seeds or (SEED,) for period in PERIODS]
    return [_standin(period, seed) for period, seed in steps(wanted, "simulating")]


def _standin(period: Period, seed: int) -> Recording:
    record = of_standin(period, read_zone, seed)
    start, end = (midnight(*day, ecolar.ZONE) for day in ecolar.PERIODS[period])
    minutes = np.arange(start, end, ecolar.GRID_STEP)
    sun = np.interp(record.times + record.period / 2, minutes, weather(minutes, seed).irradiance)
    what = f"a simulated stand-in for the unpublished {period} recording of Ecolar Home (seed {seed})"
    lit = record._replace(columns={**record.columns, SOLAR: sun})
    return Recording(f"{period}-seed{seed}", what, lit, ecolar_candidates(True), ecolar.ZONE)
