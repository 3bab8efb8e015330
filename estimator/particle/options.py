"""Options of the particle filter, and its two presets.

`paper` holds every constant that the paper and its authors' runs give, and its networks' own. `default` is what a user
gets: exact zero-order hold, logit coordinates, moment-preserving rejuvenation, jumps in log alpha, and per-step noise
scaled to the sampling period.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import inf, sqrt

from estimator.errors import OptionsError
from estimator.network.network import Network
from estimator.option_checks import check_known, checked_choice, checked_number, checked_preset, is_number

ALL_NODES = "all"


@dataclass(frozen=True)
class Options:
    """Everything the filter can be told. Standard deviations named `..._sd` of a process are per sampling step."""

    preset: str = "default"
    particles: int = 9000
    measurement_sd: float = 0.1
    """sigma_y [K], of every measured output; R = sigma_y^2."""
    process_sd: float = 0.01
    """Square root of the diagonal of Q_0 [K per step], for every state."""
    alpha_initial_sd: float = 0.1
    """log alpha_0 ~ N(0, alpha_initial_sd^2)."""
    alpha_min: float = 0.01
    alpha_max: float = 25.0
    volatility_sd: float = 0.1
    """sigma_eta of the log-random walk (21) [per step]."""
    jump_probability: float = 0.0
    """Probability per step that log alpha also jumps by N(0, jump_sd^2)."""
    jump_sd: float = 1.5
    volatility_blocks: Mapping[str, tuple[str, ...]] | None = None
    """Block name to state nodes; every block has its own alpha. None: one block of all states, as in the paper."""
    shrinkage: float = 0.974
    """a_0 of the Liu-West kernel [per step]; a_0 = (3 delta_0 - 1) / (2 delta_0) for the discount delta_0."""
    moment_preserving: bool = False
    """h_k^2 = 1 - a_k^2 instead of the paper's g_k (1 - a_0^2)."""
    variance_floor: float = 0.0
    """Smallest variance of a parameter coordinate from which rejuvenation jitters."""
    coordinates: str = "log"
    """"log" (jitter clipped to the box) or "logit" (logit of the place in the log box)."""
    gate_low: float = 0.40
    gate_high: float = 0.95
    gate_min: float = 0.05
    histogram_bins: int = 30
    histogram_pseudo_count: float = 1.0
    resample_below: float = 0.5
    """Resample when N_eff falls below this share of N."""
    implementation: str = "compiled"
    """"compiled" (Numba) or "reference" (NumPy, reads like the paper)."""


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

_RANGES: dict[str, tuple[float, float]] = {
    "particles": (50, 1_000_000),
    "measurement_sd": (1e-6, 100),
    "process_sd": (1e-9, 100),
    "alpha_initial_sd": (0, 10),
    "alpha_min": (1e-9, 1e6),
    "alpha_max": (1e-9, 1e6),
    "volatility_sd": (0, 10),
    "jump_probability": (0, 1),
    "jump_sd": (0, 10),
    "shrinkage": (0.5, 1),
    "variance_floor": (0, 1),
    "gate_low": (0, 1),
    "gate_high": (0, 1),
    "gate_min": (0, 1),
    "histogram_bins": (2, 10_000),
    "histogram_pseudo_count": (1e-9, 1e6),
    "resample_below": (0, 1),
}
_CHOICES = {"coordinates": ("log", "logit"), "implementation": ("compiled", "reference"), "preset": tuple(PRESETS)}


def resolve(network: Network, period: float, given: Mapping[str, object]) -> Options:
    """The options in force: the preset for `network` at `period` s, then what is `given`.

    `discount` may be given instead of `shrinkage`. Raises OptionsError with one sentence naming the option.
    """
    check_known(given, {field.name for field in fields(Options)} | {"discount"}, "rbpf")
    effective = PRESETS[checked_preset(given, PRESETS)](network, period) | dict(given)
    if "discount" in given:
        effective["shrinkage"] = _shrinkage(effective.pop("discount"), given)
    for name, value in effective.items():
        effective[name] = _checked(name, value, network)
    return _consistent(Options(**effective))  # type: ignore[arg-type]


def _shrinkage(discount: object, given: Mapping[str, object]) -> float:
    if "shrinkage" in given:
        raise OptionsError("'discount' and 'shrinkage' say the same thing; give one of them", "discount", "shrinkage")
    if not is_number(discount) or not 0.5 < discount <= 1:
        raise OptionsError(f"discount = {discount!r} must be a number above 0.5 and at most 1", "discount")
    return (3 * discount - 1) / (2 * discount)


def _checked(name: str, value: object, network: Network) -> object:
    if name in _CHOICES:
        return checked_choice(name, value, _CHOICES[name])
    if name == "moment_preserving":
        if not isinstance(value, bool):
            raise OptionsError(f"{name} = {value!r} must be true or false", name)
        return value
    if name == "volatility_blocks":
        return checked_blocks(value, network)
    low, high = _RANGES.get(name, (-inf, inf))
    return checked_number(name, value, low, high, whole=name in ("particles", "histogram_bins"))


def checked_blocks(value: object, network: Network) -> dict[str, tuple[str, ...]] | None:
    """Volatility blocks by name, which together name every state node once; None stays None."""
    if value is None:
        return None
    if not isinstance(value, Mapping) or not value:
        raise OptionsError("volatility_blocks must be a table of block name = [state nodes]", "volatility_blocks")
    blocks = {str(name): tuple(nodes) if isinstance(nodes, list | tuple) else () for name, nodes in value.items()}
    listed = [node for nodes in blocks.values() for node in nodes]
    if sorted(map(str, listed)) != sorted(network.nodes) or not all(blocks.values()):
        raise OptionsError(
            "volatility_blocks must name every state node exactly once; "
            f"the state nodes are {', '.join(network.nodes)}",
            "volatility_blocks",
        )
    return blocks


def _consistent(options: Options) -> Options:
    alphas, gates = ("alpha_min", "alpha_max"), ("gate_low", "gate_high")
    if options.alpha_min >= options.alpha_max:
        raise OptionsError(
            f"alpha_min = {options.alpha_min:g} must be below alpha_max = {options.alpha_max:g}", *alphas
        )
    if not options.alpha_min <= 1.0 <= options.alpha_max:
        raise OptionsError(
            "alpha_min and alpha_max must have 1, where the volatility starts, between them",
            *(alphas if options.alpha_min > 1.0 else reversed(alphas)),
        )
    if options.gate_low >= options.gate_high:
        raise OptionsError(f"gate_low = {options.gate_low:g} must be below gate_high = {options.gate_high:g}", *gates)
    return options
