"""Options of the mixture Kalman filter, and its presets: the members of a bank that trust different things.

No single noise serves all horizons. A filter with much process noise tracks best over one step and drifts over a day;
one with little process noise and a large measurement noise, close to an output-error fit, simulates a day best and is
poor over one step. Every preset is one such compromise, scaled to the sampling period.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import sqrt

from estimator.errors import OptionsError
from estimator.network.network import Network
from estimator.option_checks import check_known, checked_choice, checked_number, checked_preset
from estimator.particle.options import checked_blocks

LEARNED = "learned"


@dataclass(frozen=True)
class MKFOptions:
    """Everything the filter can be told. Standard deviations of a process are per sampling step."""

    preset: str = "default"
    particles: int = 256
    start_share: float = 0.5
    """Standard deviation of each particle's first Gaussian over phi, as a share of the prior's; centres have the rest.
    Few particles need much of it, for else it is chance where they begin."""
    process_sd: float = 0.01
    """Process noise of every state [K per step]; times alpha with `volatility = "process"`."""
    volatility: str = "process"
    """What alpha multiplies: "process" noise, the "gain"'s random walk, or nothing: "none"."""
    alpha_initial_sd: float = 2.0
    """log alpha_0 ~ N(0, alpha_initial_sd^2)."""
    alpha_min: float = 0.01
    alpha_max: float = 25.0
    volatility_sd: float = 0.1
    """sigma_eta of the log-random walk of alpha [per step]."""
    jump_probability: float = 0.02
    """Probability per step that log alpha also jumps by N(0, jump_sd^2)."""
    jump_sd: float = 1.5
    volatility_blocks: Mapping[str, tuple[str, ...]] | None = None
    """Block name to state nodes; every block has its own alpha. None: one block of all states."""
    gain: str = "switching"
    """Unmeasured heat into the first measured node: "none", "switching" on and off, or "always" on."""
    gain_walk_sd: float = 0.05
    """Random walk of a gain that is on [kW per step]; times alpha with `volatility = "gain"`."""
    gain_on_probability: float = 0.01
    """Probability per step that a gain begins."""
    gain_off_probability: float = 0.04
    """Probability per step that a gain ends."""
    gain_sd_min: float = 0.2
    gain_sd_max: float = 50.0
    """A new gain is N(0, v^2) with log v uniform between these [kW]."""
    gain_decays: bool = False
    """Whether a gain decays towards 0 with a time constant that every particle has its own guess of."""
    gain_hours_min: float = 0.3
    gain_hours_max: float = 10.0
    """Bounds of that time constant [h], log-uniform a priori."""
    measurement_sd: float | str = LEARNED
    """sigma_y [K]: "learned" for each output, or a number for all of them."""
    measurement_sd_min: float = 0.005
    measurement_sd_max: float = 0.3
    """Bounds of a learned sigma_y [K], log-uniform a priori."""
    hyper_walk_sd: float = 0.02
    """Random walk of log sigma_y and of the log of the gain's time constant [per step]."""
    parameter_sd: float = 0.001
    """Random walk of every free log parameter [per step], times the learning gate."""
    gate_low: float = 0.40
    gate_high: float = 0.95
    gate_min: float = 0.05
    histogram_bins: int = 30
    histogram_pseudo_count: float = 1.0
    resample_below: float = 0.5
    """Resample when N_eff falls below this share of N."""
    scenarios: int = 1000
    """Sampled futures that a forecast is made of at most."""
    implementation: str = "compiled"
    """"compiled" (Numba) or "reference" (NumPy, reads like the textbook)."""


_REFERENCE_PERIOD = 600.0


_JUMP: dict[str, object] = {}
_DRIFT: dict[str, object] = {
    "process_sd": 0.003,
    "volatility": "gain",
    "gain": "always",
    "gain_walk_sd": 0.02,
    "gain_decays": True,
    "alpha_max": 250.0,
}
_PLAIN: dict[str, object] = {"volatility": "none", "gain": "none", "particles": 128}
_HABITS: dict[str, object] = {
    "particles": 8,
    "start_share": 0.9,
    "volatility": "none",
    "gain": "always",
    "gain_decays": True,
    "gain_walk_sd": 0.16,
    "gain_hours_min": 1.0,
    "gain_hours_max": 1.0,
    "gain_sd_min": 0.3,
    "gain_sd_max": 0.3,
    "process_sd": 0.01,
    "parameter_sd": 0.001,
    "measurement_sd": 0.05,
}
"""For a network with terms of known heat: what is left unknown fades within an hour and has 300 W in the long run, or
within half a day and has 50 W, with a coarse sensor, which is to `habits` what `steady` is to the others.
Nothing is sampled, and all particles begin near the middle of the prior, so that the seed hardly matters."""

PRESETS: dict[str, Mapping[str, object]] = {
    "default": _JUMP,
    "jump": _JUMP,
    "drift": _DRIFT,
    "free": _PLAIN | {"process_sd": 0.05, "parameter_sd": 0.01, "measurement_sd": 0.05},
    "steady": _PLAIN
    | {
        "gain": "always",
        "gain_walk_sd": 0.003,
        "process_sd": 0.005,
        "parameter_sd": 0.003,
        "measurement_sd": 0.3,
    },
    "output-error": _PLAIN | {"process_sd": 0.005, "parameter_sd": 0.003, "measurement_sd": 0.6},
    "habits": _HABITS,
    "habits-slow": _HABITS
    | {
        "gain_walk_sd": 0.0086,
        "gain_hours_min": 11.0,
        "gain_hours_max": 11.0,
        "gain_sd_min": 0.05,
        "gain_sd_max": 0.05,
        "measurement_sd": 0.3,
    },
}
"""What differs from the defaults above, at a period of 10 minutes."""

_WALKS = ("process_sd", "volatility_sd", "gain_walk_sd", "hyper_walk_sd", "parameter_sd")
_PROBABILITIES = ("jump_probability", "gain_on_probability", "gain_off_probability")

_RANGES: dict[str, tuple[float, float]] = {
    "particles": (8, 100_000),
    "start_share": (0, 1),
    "process_sd": (1e-9, 100),
    "alpha_initial_sd": (0, 10),
    "alpha_min": (1e-9, 1e6),
    "alpha_max": (1e-9, 1e6),
    "volatility_sd": (0, 10),
    "jump_probability": (0, 1),
    "jump_sd": (0, 10),
    "gain_walk_sd": (0, 1000),
    "gain_on_probability": (0, 1),
    "gain_off_probability": (0, 1),
    "gain_sd_min": (1e-6, 1e6),
    "gain_sd_max": (1e-6, 1e6),
    "gain_hours_min": (1e-3, 1e4),
    "gain_hours_max": (1e-3, 1e4),
    "measurement_sd_min": (1e-6, 100),
    "measurement_sd_max": (1e-6, 100),
    "hyper_walk_sd": (0, 1),
    "parameter_sd": (0, 1),
    "gate_low": (0, 1),
    "gate_high": (0, 1),
    "gate_min": (0, 1),
    "histogram_bins": (2, 10_000),
    "histogram_pseudo_count": (1e-9, 1e6),
    "resample_below": (0, 1),
    "scenarios": (8, 100_000),
}
_WHOLE = ("particles", "histogram_bins", "scenarios")
_MAY_BE_ONE = (("gain_sd_min", "gain_sd_max"), ("gain_hours_min", "gain_hours_max"))
"""Bounds of what is the same in every particle where they are the same."""
_CHOICES = {
    "volatility": ("process", "gain", "none"),
    "gain": ("none", "switching", "always"),
    "implementation": ("compiled", "reference"),
    "preset": tuple(PRESETS),
}
_ORDERED = (
    ("alpha_min", "alpha_max"),
    ("measurement_sd_min", "measurement_sd_max"),
    ("gate_low", "gate_high"),
)


def resolve(network: Network, period: float, given: Mapping[str, object]) -> MKFOptions:
    """The options in force: the preset at `period` s, then what is `given`.

    Raises OptionsError with one sentence naming the option.
    """
    known = {field.name: field.default for field in fields(MKFOptions)}
    check_known(given, known, "mkf")
    effective = _scaled(known | dict(PRESETS[checked_preset(given, PRESETS)]), period) | dict(given)
    options = MKFOptions(**{name: _checked(name, value, network) for name, value in effective.items()})  # type: ignore[arg-type]
    return _consistent(options)


def _scaled(options: dict[str, object], period: float) -> dict[str, object]:
    """Per-step settings of a period of 10 minutes at another `period` [s]."""
    steps = period / _REFERENCE_PERIOD
    walks = {name: float(options[name]) * sqrt(steps) for name in _WALKS}  # type: ignore[arg-type]
    chances = {name: 1.0 - (1.0 - float(options[name])) ** steps for name in _PROBABILITIES}  # type: ignore[arg-type]
    return options | walks | chances


def _checked(name: str, value: object, network: Network) -> object:
    if name in _CHOICES:
        return checked_choice(name, value, _CHOICES[name])
    if name == "gain_decays":
        if not isinstance(value, bool):
            raise OptionsError(f"{name} = {value!r} must be true or false", name)
        return value
    if name == "volatility_blocks":
        return checked_blocks(value, network)
    if name == "measurement_sd":
        return _checked_measurement_sd(value)
    return checked_number(name, value, *_RANGES[name], whole=name in _WHOLE)


def _checked_measurement_sd(value: object) -> object:
    if value == LEARNED:
        return value
    if isinstance(value, str):
        raise OptionsError(
            f"measurement_sd = {value!r} must be 'learned' or a number from 1e-06 to 100", "measurement_sd"
        )
    return checked_number("measurement_sd", value, 1e-6, 100)


def _consistent(options: MKFOptions) -> MKFOptions:
    for low, high in _ORDERED:
        if getattr(options, low) >= getattr(options, high):
            raise OptionsError(
                f"{low} = {getattr(options, low):g} must be below {high} = {getattr(options, high):g}", low, high
            )
    for low, high in _MAY_BE_ONE:
        if getattr(options, low) > getattr(options, high):
            raise OptionsError(
                f"{low} = {getattr(options, low):g} must not be above {high} = {getattr(options, high):g}", low, high
            )
    if not options.alpha_min <= 1.0 <= options.alpha_max:
        raise OptionsError(
            "alpha_min and alpha_max must have 1, where the volatility starts, between them", "alpha_min", "alpha_max"
        )
    if options.volatility == "gain" and options.gain == "none":
        raise OptionsError(
            'volatility = "gain" needs a gain; choose gain = "switching" or "always"', "volatility", "gain"
        )
    if options.volatility_blocks is not None and options.volatility != "process":
        raise OptionsError(
            'volatility_blocks divide the process noise; they need volatility = "process"',
            "volatility_blocks",
            "volatility",
        )
    return options
