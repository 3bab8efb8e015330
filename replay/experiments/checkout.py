"""The door to the laboratory, which only a checkout of the source has: no wheel carries `replay.lab`."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

import replay
from replay.errors import ReplayError


def laboratory(module: str, what: str) -> ModuleType:
    """The module of that name below the laboratory; ReplayError where this installation has none.

    `what` names what was asked for, as the beginning of a sentence.
    """
    # Not by asking for the module: an editable installation elsewhere on this machine would answer for it.
    if not any((Path(folder) / "lab").is_dir() for folder in replay.__path__):
        raise ReplayError(f"{what} needs a checkout of Thermogate's source; the installed package does not carry it")
    return import_module(f"replay.lab.{module}")
