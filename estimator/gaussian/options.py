"""Options of the augmented-state filters, EKF and UKF, and their presets.

`paper` holds what the paper gives them (4.2.4): the process noise that its simulated data was made with, and a random
walk of .01 per step in log theta. `default` is what a user gets, scaled to the sampling period: more process noise,
since real buildings are disturbed and these filters have no other way to allow for it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt

from estimator.network.network import Network
from estimator.option_checks import checked_preset, choice, number, resolver

_REFERENCE_PERIOD = 600.0


@dataclass(frozen=True)
class AugmentedOptions:
    """What both filters can be told. Standard deviations of a process are per sampling step."""

    preset: str = choice("default", "default", "paper")
    measurement_sd: float = number(0.1, 1e-6, 100)
    """sigma_y [K], of every measured output; R = sigma_y^2."""
    process_sd: float = number(0.03, 1e-9, 100)
    """Square root of the diagonal of Q_x [K per step], for every state."""
    parameter_sd: float = number(0.01, 0, 1)
    """Square root of the diagonal of Q_phi (15) [per step], for every free parameter."""
    initial: str = choice("centre", "centre", "drawn")
    """"centre": log theta starts at the middle of its box; "drawn": at a draw from the log-uniform prior."""


@dataclass(frozen=True)
class UKFOptions(AugmentedOptions):
    """And the unscented transform."""

    sigma_reach: float = number(sqrt(3.0), 0.01, 10)
    """Distance of the sigma points from the mean, sqrt(n + kappa) [standard deviations]."""


_PAPER_ECOLAR = ("ecolar-6r4c", *(f"m{i}" for i in range(1, 9)))


def _paper(network: Network, period: float) -> dict[str, object]:
    return {"measurement_sd": 0.1 if network.name in _PAPER_ECOLAR else 0.15, "initial": "drawn"}


def _default(network: Network, period: float) -> dict[str, object]:
    steps = sqrt(period / _REFERENCE_PERIOD)
    return {"measurement_sd": 0.05, "process_sd": 0.05 * steps, "parameter_sd": 0.01 * steps}


PRESETS = {"default": _default, "paper": _paper}


def _preset(network: Network, period: float, given: Mapping[str, object]) -> dict[str, object]:
    return PRESETS[checked_preset(given, PRESETS)](network, period)


resolve_ekf = resolver(AugmentedOptions, "ekf", _preset)
resolve_ukf = resolver(UKFOptions, "ukf", _preset)
