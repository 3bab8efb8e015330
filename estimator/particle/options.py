"""Options of the particle filter, and its two presets.

`paper` holds every constant that the paper and its authors' runs give, and its networks' own. `default` is what a user
gets: exact zero-order hold, logit coordinates, moment-preserving rejuvenation, jumps in log alpha, and per-step noise
scaled to the sampling period.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import Self

from estimator.errors import OptionsError
from estimator.network.network import Network
from estimator.option_checks import (
    blocks,
    check_known,
    check_order,
    check_start,
    checked_preset,
    choice,
    flag,
    in_force,
    is_number,
    names,
    number,
    whole,
)

ALL_NODES = "all"


@dataclass(frozen=True)
class VolatilityOptions:
    """What particle and mixture Kalman filters share: options of volatility, learning gate and resampling. Standard
    deviations named `..._sd` of a process are per sampling step."""

    preset: str
    particles: int
    process_sd: float = number(0.01, 1e-9, 100)
    """Square root of the diagonal of Q_0 [K per step], for every state."""
    alpha_initial_sd: float = number(2.0, 0, 10)
    """log alpha_0 ~ N(0, alpha_initial_sd^2)."""
    alpha_min: float = number(0.01, 1e-9, 1e6)
    alpha_max: float = number(25.0, 1e-9, 1e6)
    volatility_sd: float = number(0.1, 0, 10)
    """sigma_eta of the log-random walk (21) [per step]."""
    jump_probability: float = number(0.02, 0, 1)
    """Probability per step that log alpha also jumps by N(0, jump_sd^2)."""
    jump_sd: float = number(1.5, 0, 10)
    volatility_blocks: Mapping[str, tuple[str, ...]] | None = blocks()
    """Block name to state nodes; every block has its own alpha. None: one block of all states, as in the paper."""
    gate_low: float = number(0.40, 0, 1)
    gate_high: float = number(0.95, 0, 1)
    gate_min: float = number(0.05, 0, 1)
    histogram_bins: int = whole(30, 2, 10_000)
    histogram_pseudo_count: float = number(1.0, 1e-9, 1e6)
    resample_below: float = number(0.5, 0, 1)
    """Resample when N_eff falls below this share of N."""
    implementation: str = choice("compiled", "compiled", "reference")
    """"compiled" (Numba) or "reference" (NumPy, reads like the textbook)."""

    def checked(self) -> Self:
        """The same, in order. Raises OptionsError."""
        check_order(self, ("alpha_min", "alpha_max"), ("gate_low", "gate_high"))
        check_start(self)
        return self


@dataclass(frozen=True)
class Options(VolatilityOptions):
    """Everything the particle filter can be told."""

    preset: str = choice("default", "default", "paper")
    particles: int = whole(9000, 50, 1_000_000)
    measurement_sd: float = number(0.1, 1e-6, 100)
    """sigma_y [K], of every measured output; R = sigma_y^2."""
    alpha_initial_sd: float = number(0.1, 0, 10)
    jump_probability: float = number(0.0, 0, 1)
    shrinkage: float = number(0.974, 0.5, 1)
    """a_0 of the Liu-West kernel [per step]; a_0 = (3 delta_0 - 1) / (2 delta_0) for the discount delta_0."""
    moment_preserving: bool = flag(False)
    """h_k^2 = 1 - a_k^2 instead of the paper's g_k (1 - a_0^2)."""
    variance_floor: float = number(0.0, 0, 1)
    """Smallest variance of a parameter coordinate from which rejuvenation jitters."""
    coordinates: str = choice("log", "log", "logit")
    """"log" (jitter clipped to the box) or "logit" (logit of the place in the log box)."""


DISCOUNT = 0.95
_REFERENCE_PERIOD = 600.0

_PAPER: dict[str, object] = {"shrinkage": (3 * DISCOUNT - 1) / (2 * DISCOUNT), "measurement_sd": 0.15}
_PAPER_ECOLAR: dict[str, object] = {
    "particles": 20000,
    "measurement_sd": 0.1,
    "process_sd": 0.03,
    "alpha_max": 15.0,
    "volatility_sd": 0.05,
}
_PAPER_NETWORKS = dict.fromkeys(("ecolar-6r4c", *(f"m{i}" for i in range(1, 9))), _PAPER_ECOLAR)


def _paper(network: Network, period: float) -> dict[str, object]:
    return _PAPER | _PAPER_NETWORKS.get(network.name, {})


def _default(network: Network, period: float) -> dict[str, object]:
    steps = period / _REFERENCE_PERIOD
    return {
        "measurement_sd": 0.05,
        "process_sd": 0.01 * sqrt(steps),
        "volatility_sd": 0.1 * sqrt(steps),
        # Before any sample nobody knows how far the model can be trusted; a sharp start would commit to few particles.
        "alpha_initial_sd": 2.0,
        "jump_probability": 1.0 - 0.98**steps,
        # Beyond some hours the kernel could forget no more than this without jumping about.
        "shrinkage": max(((3 * DISCOUNT - 1) / (2 * DISCOUNT)) ** steps, 0.5),
        "moment_preserving": True,
        "variance_floor": 1e-6,
        "coordinates": "logit",
    }


PRESETS = {"default": _default, "paper": _paper}


def resolve(network: Network, period: float, given: Mapping[str, object]) -> Options:
    """The options in force: the preset for `network` at `period` s, then what is `given`.

    `discount` may be given instead of `shrinkage`. Raises OptionsError with one sentence naming the option.
    """
    check_known(given, names(Options) | {"discount"}, "rbpf")
    effective = PRESETS[checked_preset(given, PRESETS)](network, period) | dict(given)
    if "discount" in given:
        effective["shrinkage"] = _shrinkage(effective.pop("discount"), given)
    return in_force(Options, network, effective).checked()


def _shrinkage(discount: object, given: Mapping[str, object]) -> float:
    if "shrinkage" in given:
        raise OptionsError("'discount' and 'shrinkage' say the same thing; give one of them", "discount", "shrinkage")
    if not is_number(discount) or not 0.5 < discount <= 1:
        raise OptionsError(f"discount = {discount!r} must be a number above 0.5 and at most 1", "discount")
    return (3 * discount - 1) / (2 * discount)
