"""Thermogate in Python: pandas in and out, for notebooks and scripts. `docs/python.md` has examples.

    import thermogate as tg

    model = tg.fit(df)
    model.forecast({"u_heat": 1500.0}, horizon="24h")

`fit` runs the estimator of the daemon over a table of measurements and returns a `Model`; `load` reads a model that
`Model.save` wrote. `backtest` and `compare` score the forecasts that estimators would have made along a table.
Importing this package is quick: the estimator is imported when one of the names is first used.
Nobody but notebooks and scripts comes in here; inside, `frames` is where pandas is.
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from service.daemon.process import prepare_process
from service.errors import ConfigError, DataError, ServiceError

if TYPE_CHECKING:
    from thermogate.backtesting import Backtest, backtest, compare
    from thermogate.fitting import fit, load
    from thermogate.model import Model

__all__ = [
    "Backtest",
    "ConfigError",
    "DataError",
    "Model",
    "ServiceError",
    "__version__",
    "backtest",
    "compare",
    "fit",
    "load",
]

__version__ = version("thermogate")

_LATER = {
    **dict.fromkeys(("Model", "fit", "load"), "thermogate.fitting"),
    **dict.fromkeys(("Backtest", "backtest", "compare"), "thermogate.backtesting"),
}
"""The module of each name that needs the estimator."""


def __getattr__(name: str) -> Any:
    """What needs the estimator, imported when it is asked for: the kernel cache is chosen before Numba is imported."""
    if name not in _LATER:
        raise AttributeError(f"module 'thermogate' has no attribute '{name}'")
    prepare_process(shared=True)
    found = globals()[name] = getattr(import_module(_LATER[name]), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_LATER})
