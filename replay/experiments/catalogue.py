"""The experiments by name. A new one is one module with `prepare(request) -> Experiment`, and one line here."""

from __future__ import annotations

from typing import NamedTuple


class Entry(NamedTuple):
    """Where an experiment lives and what it does. Only a checkout has `replay.lab`, below which one `in_lab` is."""

    module: str
    text: str
    in_lab: bool = True


# Names of modules, not modules: `thermogate --help` lists these without waiting for the compiler.
EXPERIMENTS = {
    "semi-synthetic": Entry(
        "experiments.semi_synthetic.experiment",
        "a simulated building with a known truth and heat gains that nobody measures (Tables 4 to 6)",
    ),
    "ecolar": Entry(
        "experiments.ecolar.experiment",
        "a lived-in zone whose truth nobody knows: forecasts, and nights without measurements (Tables 7 and 8)",
    ),
    "topology": Entry(
        "replay.experiments.topology.experiment",
        "which RC network to take: the paper's candidates and one's own, fitted and ranked (Tables 2 and 3)",
        in_lab=False,
    ),
    "hours-ahead": Entry(
        "replay.experiments.hours_ahead.experiment",
        "forecasts of the next step and up to a day ahead, by every estimator on measured and simulated recordings",
        in_lab=False,
    ),
    "control": Entry(
        "experiments.control.experiment",
        "the loop closed over buildings of EnergyPlus: thermostat, planners, and perfect knowledge",
    ),
    "preheat": Entry(
        "experiments.preheat",
        "is a room of EnergyPlus warm in time, and not much too early, when its heating starts as Thermogate says",
    ),
    "sensitivity": Entry(
        "experiments.sensitivity",
        "what particles, volatility noise, gate thresholds and sensor noise do (5.1.5)",
    ),
    "lies": Entry(
        "experiments.lies",
        "sensors and meters that lie in buildings of EnergyPlus: what is found, how soon, and false alarms",
    ),
}
