"""The experiments by name, as `catalogue.toml` has them."""

import tomllib
from collections.abc import Mapping
from importlib import import_module
from importlib.resources import files
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import replay
from replay.errors import ReplayError

LABORATORY = "replay.lab."
"""What no wheel carries: only a checkout of the source has it."""


class Entry(NamedTuple):
    """Where an experiment lives and what it does."""

    module: str
    text: str


EXPERIMENTS: Mapping[str, Entry] = {
    name: Entry(**table)
    for name, table in tomllib.loads(files(__package__).joinpath("catalogue.toml").read_text(encoding="utf-8")).items()
}
"""Names of modules, not modules: `thermogate --help` lists these without waiting for the compiler."""


def module_of(name: str) -> ModuleType:
    """The module of the experiment `name`; ReplayError where this installation has none."""
    place = EXPERIMENTS[name].module
    return laboratory(place, f"experiment {name}") if place.startswith(LABORATORY) else import_module(place)


def laboratory(module: str, what: str) -> ModuleType:
    """That module of the laboratory; ReplayError, which begins with `what` was asked for, without one."""
    # Not by asking for the module: an editable installation elsewhere on this machine would answer for it.
    if not any((Path(folder) / "lab").is_dir() for folder in replay.__path__):
        raise ReplayError(f"{what} needs a checkout of Thermogate's source; the installed package does not carry it")
    return import_module(module)
