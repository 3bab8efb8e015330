"""Ends every process that takes a zone over a poisoned sample, as a fault in compiled code would.

Python imports this by itself where the folder is in PYTHONPATH.
"""

import builtins
import os
import signal
import sys
from typing import Any

POISON = 33.75
"""The measured temperature that it is about, degC."""

_import = builtins.__import__


def _imported(*arguments: Any, **options: Any) -> Any:
    """Import as ever, and change the worker as soon as it is there."""
    found = _import(*arguments, **options)
    worker = getattr(sys.modules.get("service.zone.worker"), "ZoneWorker", None)
    if worker is not None:
        builtins.__import__ = _import
        step = worker.step

        def poisoned(worker: Any, sample: Any) -> Any:
            if POISON in sample.outputs:
                os.kill(os.getpid(), signal.SIGKILL)
            return step(worker, sample)

        worker.step = poisoned
    return found


builtins.__import__ = _imported
