"""`deploy/examples/mpc.py`, the controller that customers are given: this experiment is one of them."""

from __future__ import annotations

import importlib.util
import sys
from functools import lru_cache
from pathlib import Path
from types import ModuleType

import replay
from replay.errors import ReplayError

_NAME = "thermogate_example_mpc"


def path() -> Path:
    """Where it is in a checkout."""
    return Path(replay.__file__).parents[1] / "deploy" / "examples" / "mpc.py"


@lru_cache(maxsize=1)
def mpc() -> ModuleType:
    """The example as a module; ReplayError where there is no checkout."""
    if not path().is_file():
        raise ReplayError(
            f"{path()} is not there: this experiment closes the loop with the example of a controller, which is in a "
            "checkout of the project and not in its wheel; run it from a checkout"
        )
    spec = importlib.util.spec_from_file_location(_NAME, path())
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Its dataclasses look themselves up.
    sys.modules[_NAME] = module
    spec.loader.exec_module(module)
    return module
