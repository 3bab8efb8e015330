"""`deploy/examples/mpc.py`, the controller that customers are given: this experiment is one of them."""

import importlib.util
import sys
from functools import lru_cache
from types import ModuleType

from replay.lab import EXAMPLES

PATH = EXAMPLES / "mpc.py"
_NAME = "thermogate_example_mpc"


@lru_cache(maxsize=1)
def mpc() -> ModuleType:
    spec = importlib.util.spec_from_file_location(_NAME, PATH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Its dataclasses look themselves up.
    sys.modules[_NAME] = module
    spec.loader.exec_module(module)
    return module
