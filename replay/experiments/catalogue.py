"""The experiments by name. A new one is one module with `prepare(request) -> Experiment`, and one line here."""

from __future__ import annotations

from importlib import import_module
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


# Names of modules, not modules: `thermogate --help` lists these without waiting for the compiler.
EXPERIMENTS = {
    "semi-synthetic": Entry(
        "replay.lab.experiments.semi_synthetic.experiment",
        "a simulated building with a known truth and heat gains that nobody measures (Tables 4 to 6)",
    ),
    "ecolar": Entry(
        "replay.lab.experiments.ecolar.experiment",
        "a lived-in zone whose truth nobody knows: forecasts, and nights without measurements (Tables 7 and 8)",
    ),
    "topology": Entry(
        "replay.experiments.topology.experiment",
        "which RC network to take: the paper's candidates and one's own, fitted and ranked (Tables 2 and 3)",
    ),
    "hours-ahead": Entry(
        "replay.experiments.hours_ahead.experiment",
        "forecasts of the next step and up to a day ahead, by every estimator on measured and simulated recordings",
    ),
    "control": Entry(
        "replay.lab.experiments.control.experiment",
        "the loop closed over buildings of EnergyPlus: thermostat, planners, and perfect knowledge",
    ),
    "preheat": Entry(
        "replay.lab.experiments.preheat",
        "is a room of EnergyPlus warm in time, and not much too early, when its heating starts as Thermogate says",
    ),
    "sensitivity": Entry(
        "replay.lab.experiments.sensitivity",
        "what particles, volatility noise, gate thresholds and sensor noise do (5.1.5)",
    ),
    "lies": Entry(
        "replay.lab.experiments.lies",
        "sensors and meters that lie in buildings of EnergyPlus: what is found, how soon, and false alarms",
    ),
}


def laboratory(module: str, what: str) -> ModuleType:
    """That module of the laboratory; ReplayError where this installation has none.

    `what` names what was asked for, as the beginning of a sentence.
    """
    # Not by asking for the module: an editable installation elsewhere on this machine would answer for it.
    if not any((Path(folder) / "lab").is_dir() for folder in replay.__path__):
        raise ReplayError(f"{what} needs a checkout of Thermogate's source; the installed package does not carry it")
    return import_module(module)
