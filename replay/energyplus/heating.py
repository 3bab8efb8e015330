"""How the panels of a building are driven: on and off, in proportion, or by a plan that does not look at the room."""

from collections.abc import Callable, Mapping

import numpy as np
from scipy.signal import max_len_seq

from estimator.arrays import Array
from replay.energyplus.buildings import Building
from replay.errors import ReplayError

Heating = Callable[[float, Array, Array], Array]
"""Power (N,) in W for the step at a local time [s], from the air (N,) and the set-points (N,) in degC."""

_HYSTERESIS = 0.6  # K, whole width
_BAND = 1.5  # K below the set-point, at which a panel gives all it has
_HOLD = 1800.0  # s, the shortest time between two switches of the plan
_REGISTER_BITS = 10
_PLANNED_SHARE = 0.4  # of the rated power while the plan says on
_COLDEST, _WARMEST = 15.0, 26.0  # degC, outside which the plan is overruled


class OnOff:
    """A relay with hysteresis around the set-point for every room, off at first."""

    def __init__(self, rated: Array) -> None:
        self._rated, self._on = rated, np.zeros(len(rated), dtype=bool)

    def __call__(self, local: float, air: Array, set_points: Array) -> Array:
        excess = air - set_points
        self._on = np.where(np.abs(excess) > _HYSTERESIS / 2, excess < 0.0, self._on)
        return np.asarray(self._on * self._rated, dtype=np.float64)


def proportional(rated: Array, air: Array, set_points: Array, band: float = _BAND) -> Array:
    """Power (N,) in W in proportion to what is missing to the set-points, all of it `band` K below."""
    return np.asarray(np.clip((set_points - air) / band, 0.0, 1.0) * rated, dtype=np.float64)


class Planned:
    """A pseudo-random binary sequence (PRBS) for every room, which repeats after three weeks: the maximum-length
    sequence, for each from another place on. It is overruled only where a room would become too cold or too warm."""

    def __init__(self, rated: Array, seed: int) -> None:
        self._rated = rated
        sequence = max_len_seq(_REGISTER_BITS)[0]
        offsets = np.random.default_rng([seed, 0x9B5]).integers(0, len(sequence), len(rated))
        self._plan = np.column_stack([np.roll(sequence, offset) for offset in offsets])

    def __call__(self, local: float, air: Array, set_points: Array) -> Array:
        on = self._plan[int(local // _HOLD) % len(self._plan)] > 0
        on = np.where(air < _COLDEST, True, np.where(air > _WARMEST, False, on))
        return np.asarray(on * _PLANNED_SHARE * self._rated, dtype=np.float64)


HEATINGS: Mapping[str, Callable[[Array, int], Heating]] = {
    "on-off": lambda rated, seed: OnOff(rated),
    "proportional": lambda rated, seed: lambda local, air, set_points: proportional(rated, air, set_points),
    "planned": Planned,
}


def heating_named(name: str, building: Building, seed: int) -> Heating:
    """A new controller of that name for the heaters of `building`; ReplayError, listing the names, for another name."""
    if name not in HEATINGS:
        raise ReplayError(f"there is no heating '{name}'; there are {', '.join(HEATINGS)}")
    return HEATINGS[name](np.array([room.heater for room in building.rooms]), seed)
