"""Ends every process that takes a zone over a poisoned sample, as a fault in compiled code would.

Python imports this by itself where the folder is in PYTHONPATH.
"""

from __future__ import annotations

import importlib.util
import os
import signal
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

POISON = 33.75
"""The measured temperature that it is about, degC."""

_MODULE = "service.zone.worker"


class _Finder(MetaPathFinder):
    """Changes the module as it is imported, and nothing before."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != _MODULE:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        assert spec is not None
        loader: Any = spec.loader
        execute = loader.exec_module

        def executed(module: Any) -> None:
            execute(module)
            step = module.ZoneWorker.step

            def poisoned(worker: Any, sample: Any) -> Any:
                if POISON in sample.outputs:
                    os.kill(os.getpid(), signal.SIGKILL)
                return step(worker, sample)

            module.ZoneWorker.step = poisoned

        loader.exec_module = executed
        return spec


sys.meta_path.insert(0, _Finder())
