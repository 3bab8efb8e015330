"""The recordings that forecasts are compared on, each with a network that a user would take.

A new one is a function from the folder of --data to a `Recording`, and one line in `RECORDINGS`.
"""

from __future__ import annotations

import csv
import logging
import tempfile
from collections.abc import Callable, Mapping, Sequence
from datetime import date
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.heat.sun import Location
from estimator.network import presets
from estimator.network.network import Network
from replay.energyplus.buildings import building_named
from replay.energyplus.heat_loss import heat_loss
from replay.energyplus.library import EnergyPlusMissing
from replay.energyplus.plant import STEP
from replay.energyplus.recording import record
from replay.errors import ReplayError
from replay.experiments.hours_ahead.recordings import Known, Recording, of_zone
from replay.experiments.progress import steps
from replay.experiments.request import Request
from replay.experiments.series.filtering import Series
from replay.lab.experiments import rooms
from replay.lab.experiments.ecolar.experiment import configuration
from replay.lab.experiments.semi_synthetic.case import simulated_case
from replay.localtime import HOUR
from replay.simulated import ecolar
from replay.simulated.semi_synthetic import PERIOD as WEATHER_PERIOD
from service.config.known_heat import usually_heated
from service.config.site import Whereabouts

_DATA_SEED = 1
"""Of simulated recordings: the seeds of a run are the estimators' own."""
_BRIDGED, _HELD = 12, 900.0
"""`max_gap` and `hold_inputs` of a zone that does not set them."""

FLEXHOUSE = "flexhouse_prbs1/inputPRBS1.csv"
DARKGREYBOX = "darkgreybox_demo/demo_data.csv"
ARMADILLO = "armadillo/armadillo_data_H2.csv"
WEATHER = "semi_synthetic/weather_lyngby_2016_10min.csv"
FILES = (FLEXHOUSE, DARKGREYBOX, ARMADILLO, WEATHER, *rooms.FILES)
"""What is looked for in the folder of --data."""

_FIRST_DAY, _DAYS = date(2025, 1, 6), 28
"""Of the recordings of EnergyPlus: three weeks to learn in, and one more."""

_CHICAGO, _DENVER = Location(41.98, -87.92), Location(39.74, -105.18)

_log = logging.getLogger(__name__)

Reader = Callable[[Path | None], Recording | None]
"""A recording from the folder of --data (None: none was given); None where what it needs is not there, and
EnergyPlusMissing where that is EnergyPlus."""


def at_hand(folder: Path | None, names: Sequence[str]) -> list[Recording]:
    """Every recording of RECORDINGS, or those of `names`, whose data are there, some of them in `folder`.

    One sentence in the log says what EnergyPlus would add. Raises ReplayError where `folder` holds no recording, and
    where one of `names` is not there.
    """
    if folder is not None and not any((folder / path).exists() for path in FILES):
        raise ReplayError(f"--data {folder}: it holds none of {', '.join(FILES)}")
    unknown = [name for name in names if name not in RECORDINGS]
    if unknown:
        raise ReplayError(f"--recording {unknown[0]}: there is none; there are {', '.join(RECORDINGS)}")
    asked, found, missing = names or tuple(RECORDINGS), [], None
    for name in steps(asked, "reading", len(asked)):
        try:
            recording = RECORDINGS[name](folder)
        except EnergyPlusMissing as error:
            missing = error
            continue
        if recording is not None:
            found.append(recording)
        elif names:
            raise ReplayError(f"--recording {name}: its file is not there; name the folder that has it with --data")
    if missing is not None:
        _log.warning("the buildings of EnergyPlus are left out: %s", missing)
    if not found:
        raise ReplayError("no recording is at hand; name the folder of the data with --data")
    return found


def unbroken_series(output: Array, inputs: list[Array], period: int) -> Series:
    """One segment every `period` s from the channels (K,) of one output and of the inputs, in the network's order."""
    starts = np.zeros(len(output), dtype=np.bool_)
    starts[0] = True
    return Series(period * np.arange(len(output)), output[:, None], np.column_stack(inputs), starts)


def read_columns(path: Path, *names: str) -> list[Array]:
    """The named columns (K,) of a published CSV file; ReplayError where it is not what it should be."""
    with rooms.explained(path), path.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file))
        table = [np.array([float(row[name]) for row in rows]) for name in names]
    if not rows or not all(np.isfinite(values).all() for values in table):
        raise ReplayError(f"{path}: it is empty or has gaps; this is not the published file")
    return table


class Published(NamedTuple):
    """A real room in a file of its own without gaps: by channel the column and what it is multiplied with."""

    file: str
    what: str
    period: int
    network: Network
    channels: Mapping[str, tuple[str, float]]
    rows: slice = slice(None)


_BY_SUN = presets.titethria().with_solar("T_i", presets.SOLAR_APERTURE).validate()
PUBLISHED = {
    "FlexHouse": Published(
        FLEXHOUSE,
        "a light-weight office at Risø heated by a binary sequence; TiTeThRia with a free solar aperture",
        300,
        _BY_SUN,
        {"T_i": ("yTi", 1.0), "T_out": ("Ta", 1.0), "u_heat": ("Ph", 1000.0), "I_sol": ("Ps", 1000.0)},
    ),
    "darkgreybox demo": Published(
        DARKGREYBOX,
        "a large building without a measurement of the sun; TiTeThRia with the bounds of the preset",
        HOUR,
        presets.titethria().validate(),
        {"T_i": ("Ti", 1.0), "T_out": ("Ta", 1.0), "u_heat": ("Ph", 1000.0)},
    ),
    "armadillo": Published(
        ARMADILLO,
        "a small test house; TiTeThRia with a free solar aperture",
        1800,
        _BY_SUN,
        {"T_i": ("T_int", 1.0), "T_out": ("T_ext", 1.0), "u_heat": ("P_hea", 1.0), "I_sol": ("I_sol", 1.0)},
        # The last row is dropped, as in what its authors published.
        slice(-1),
    ),
}


def _published(name: str, folder: Path | None) -> Recording | None:
    one = PUBLISHED[name]
    path = folder and folder / one.file
    if path is None or not path.exists():
        return None
    read = read_columns(path, *(column for column, _ in one.channels.values()))
    scaled = zip(one.channels, (factor for _, factor in one.channels.values()), read, strict=True)
    columns = {channel: factor * values[one.rows] for channel, factor, values in scaled}
    inputs = [columns[channel] for channel in one.network.inputs]
    series = unbroken_series(columns["T_i"], inputs, one.period)
    return Recording(name, one.what, True, one.network, one.period, series)


def _building_67(folder: Path | None) -> Recording:
    path = folder and folder / WEATHER
    measured = path is not None and path.exists()
    request = Request(data=(path,) if path is not None and measured else ())
    network = presets.building_67().validate()
    series = simulated_case(network, request, _DATA_SEED).series
    weather = "weather measured in Lyngby" if measured else "generated weather"
    what = f"the paper's building over {weather}, simulated, with an unmeasured heat gain; its own network, all free"
    return Recording("building 67", what, False, network, WEATHER_PERIOD, series)


def _ecolar(period: ecolar.Period, folder: Path | None) -> Recording:
    with tempfile.TemporaryDirectory(prefix="thermogate-hours-ahead-") as directory:
        log = ecolar.write_standin(Path(directory) / f"ecolar-{period}-SYNTHETIC.csv", period)
        config = configuration(log)
        zone = config.zones[0].model_copy(update={"max_gap": _BRIDGED, "hold_inputs": _HELD})
        recording = of_zone(config, zone)
    what = "the stand-in for the lived-in Ecolar zone, simulated, with sun that no sensor sees; the paper's network"
    return recording._replace(name=f"Ecolar {period}", what=what, measured=False)


def _energyplus(name: str, room: str, heating: str, weather: str, location: Location, folder: Path | None) -> Recording:
    """Room `room` of a building of EnergyPlus, with the network that a zone with its channels gets by default."""
    building = building_named(name)
    index = [known.name for known in building.rooms].index(room)
    life = record(building, weather, begin=_FIRST_DAY, days=_DAYS, heating=heating, seed=_DATA_SEED)
    columns = {"T_out": life.outdoor, "u_heat": life.heating[:, index], "I_sol": life.irradiance}
    beside = building.neighbours(index)
    columns |= {f"T_adj_{building.rooms[other].name}": life.air[:, other] for other in beside}
    network = usually_heated(presets.automatic(columns), location)
    series = unbroken_series(life.air[:, index], [columns[channel] for channel in network.inputs], round(STEP))
    series = series._replace(times=life.times)
    loss = heat_loss(building, life.weather, outdoor=float(life.outdoor.mean()), wind=float(life.wind.mean()))
    ended = np.concatenate([[np.nan], life.truth.gain[:-1, index]])
    where = f"its room '{room}', heating {heating}, weather {weather}"
    what = f"{building.what}, simulated by EnergyPlus: {where}; the network auto"
    known = Known(ended, float(loss.outdoors[index]))
    return Recording(f"EnergyPlus {name}", what, False, network, round(STEP), series, known, Whereabouts(location))


RECORDINGS: Mapping[str, Reader] = {
    **{name: partial(_published, name) for name in PUBLISHED},
    **{name: partial(rooms.read_room, name) for name in rooms.ROOMS},
    "building 67": _building_67,
    "Ecolar spring": partial(_ecolar, "spring"),
    "Ecolar autumn": partial(_ecolar, "autumn"),
    "EnergyPlus house": partial(_energyplus, "house", "ground", "on-off", "chicago", _CHICAGO),
    "EnergyPlus timber": partial(_energyplus, "timber", "house", "planned", "denver", _DENVER),
    "EnergyPlus office": partial(_energyplus, "office", "west", "proportional", "chicago", _CHICAGO),
}
