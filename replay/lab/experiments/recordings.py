"""The recordings that forecasts are compared on, each with a network that a user would take.

A new one is a function from the folder of --data to a `Recording`, and one line in `RECORDINGS`.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from datetime import date
from functools import partial
from pathlib import Path

import numpy as np

from estimator.network import presets
from replay.energyplus.buildings import building_named
from replay.energyplus.heat_loss import heat_loss
from replay.energyplus.library import EnergyPlusMissing
from replay.energyplus.plant import STEP
from replay.energyplus.recording import Recording as Life
from replay.energyplus.recording import record
from replay.errors import ReplayError
from replay.experiments.hours_ahead.recordings import Known, Recording, of_zone
from replay.experiments.progress import steps
from replay.experiments.request import Request
from replay.experiments.series.recorded_zone import ZoneRecord, bridged
from replay.lab.experiments import rooms
from replay.lab.experiments.ecolar.standins import of_standin
from replay.lab.experiments.semi_synthetic.building import NETWORK, simulated_case
from replay.simulated import ecolar
from replay.simulated.semi_synthetic import PERIOD as WEATHER_PERIOD
from service.config.known_heat import usually_heated
from service.config.site import Whereabouts
from service.records.outlook import SET_POINTS

_DATA_SEED = 1
"""Of simulated recordings: the seeds of a run are the estimators' own."""
_HELD = 900.0
"""`hold_inputs` of a zone that does not set it."""

WEATHER = "semi_synthetic/weather_lyngby_2016_10min.csv"
FILES = (*rooms.FILES, WEATHER)
"""What is looked for in the folder of --data."""

FIRST_DAY, _DAYS = date(2025, 1, 6), 28
"""Of the recordings of EnergyPlus: three weeks to learn in, and one more."""

KEPT_WARM = "EnergyPlus timber with a thermostat"

_log = logging.getLogger(__name__)

Reader = Callable[[Path | None], Recording | None]
"""A recording from the folder of --data (None: none was given); None where what it needs is not there, and
EnergyPlusMissing where that is EnergyPlus."""


def at_hand(folder: Path | None, names: Sequence[str]) -> list[Recording]:
    """Every recording of RECORDINGS, or those of `names`, whose data are there, some of them in `folder`; the log says
    what EnergyPlus would add. ReplayError where `folder` holds no recording, or one of `names` is not there."""
    rooms.check_folder(folder, FILES)
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


def _building_67(folder: Path | None) -> Recording:
    path = folder and folder / WEATHER
    measured = path is not None and path.exists()
    request = Request(data=(path,) if path is not None and measured else ())
    series = simulated_case(request, _DATA_SEED).series
    weather = "weather measured in Lyngby" if measured else "generated weather"
    what = f"the paper's building over {weather}, simulated, with an unmeasured heat gain; its own network, all free"
    return Recording("building 67", what, False, NETWORK, WEATHER_PERIOD, series)


def _ecolar(period: ecolar.Period, folder: Path | None) -> Recording:
    usual = {"max_gap": rooms.BRIDGED, "hold_inputs": _HELD}
    recording = of_standin(period, lambda config, zone: of_zone(config, zone.model_copy(update=usual)))
    what = "the stand-in for the lived-in Ecolar zone, simulated, with sun that no sensor sees; the paper's network"
    return recording._replace(name=f"Ecolar {period}", what=what, measured=False)


def _energyplus(name: str, room: str, heating: str, weather: str, folder: Path | None, title: str = "") -> Recording:
    """Room `room` of a building of EnergyPlus; set-points are told where a thermostat keeps them."""
    building = building_named(name)
    index = [known.name for known in building.rooms].index(room)
    life = record(building, weather, begin=FIRST_DAY, days=_DAYS, heating=heating, seed=_DATA_SEED)
    simulated = energyplus_room(life, index)
    loss = heat_loss(building, life.weather, outdoor=float(life.outdoor.mean()), wind=float(life.wind.mean()))
    ended = np.concatenate([[np.nan], life.truth.gain[:-1, index]])
    where = f"its room '{room}', heating {heating}, weather {weather}"
    what = f"{building.what}, simulated by EnergyPlus: {where}; the network auto"
    series = simulated.series
    if heating == "planned":
        series = series._replace(setpoints=None)
    known = Known(ended, float(loss.outdoors[index]))
    return simulated._replace(name=title or f"EnergyPlus {name}", what=what, series=series, known=known)


def energyplus_room(life: Life, index: int) -> Recording:
    """The room at `index` of a recording, with the network that a zone with its channels gets by default."""
    building, location = life.building, life.weather.location
    columns = {
        "T_i": life.air[:, index],
        "T_out": life.outdoor,
        "u_heat": life.heating[:, index],
        "I_sol": life.irradiance,
        SET_POINTS: life.set_points[:, index],
    }
    beside = building.neighbours(index)
    columns |= {f"T_adj_{building.rooms[other].name}": life.air[:, other] for other in beside}
    network = usually_heated(presets.automatic(columns), location)
    series = bridged(ZoneRecord(life.times, round(STEP), columns), network, rooms.BRIDGED)
    name, what = f"EnergyPlus {building.name} {building.rooms[index].name}", building.what
    return Recording(name, what, False, network, round(STEP), series, whereabouts=Whereabouts(location))


RECORDINGS: Mapping[str, Reader] = {
    **{name: partial(rooms.read_room, name) for name in rooms.ROOMS},
    "building 67": _building_67,
    "Ecolar spring": partial(_ecolar, "spring"),
    "Ecolar autumn": partial(_ecolar, "autumn"),
    "EnergyPlus house": partial(_energyplus, "house", "ground", "on-off", "chicago"),
    "EnergyPlus timber": partial(_energyplus, "timber", "house", "planned", "denver"),
    KEPT_WARM: partial(_energyplus, "timber", "house", "on-off", "denver", title=KEPT_WARM),
    "EnergyPlus office": partial(_energyplus, "office", "west", "proportional", "chicago"),
}
