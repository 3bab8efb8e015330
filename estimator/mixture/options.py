"""Options of the mixture Kalman filter, and its presets: the members of a bank that trust different things.

No single noise serves all horizons. A filter with much process noise tracks best over one step and drifts over a day;
one with little process noise and a large measurement noise, close to an output-error fit, simulates a day best and is
poor over one step. Every preset is one such compromise, scaled to the sampling period.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import sqrt

from estimator.errors import OptionsError
from estimator.network.network import Network
from estimator.option_checks import (
    check_known,
    check_order,
    checked_choice,
    checked_number,
    checked_preset,
    choice,
    flag,
    in_force,
    number,
    option,
    whole,
)
from estimator.particle.options import VolatilityOptions

LEARNED = "learned"


def _checked_measurement_sd(name: str, value: object, network: Network) -> object:
    if value == LEARNED:
        return value
    if isinstance(value, str):
        raise OptionsError(f"{name} = {value!r} must be 'learned' or a number from 1e-06 to 100", name)
    return checked_number(name, value, 1e-6, 100)


@dataclass(frozen=True)
class MKFOptions(VolatilityOptions):
    """Everything the filter can be told. Process noise is times alpha with `volatility = "process"`."""

    preset: str = option("default", lambda name, value, _: checked_choice(name, value, PRESETS))
    particles: int = whole(256, 8, 100_000)
    start_share: float = number(0.5, 0, 1)
    """Standard deviation of each particle's first Gaussian over phi, as a share of the prior's; centres have the rest.
    Few particles need much of it, for else it is chance where they begin."""
    volatility: str = choice("process", "process", "gain", "none")
    """What alpha multiplies: "process" noise, the "gain"'s random walk, or nothing: "none"."""
    gain: str = choice("switching", "none", "switching", "always")
    """Unmeasured heat into the first measured node: "none", "switching" on and off, or "always" on."""
    gain_walk_sd: float = number(0.05, 0, 1000)
    """Random walk of a gain that is on [kW per step]; times alpha with `volatility = "gain"`."""
    gain_on_probability: float = number(0.01, 0, 1)
    """Probability per step that a gain begins."""
    gain_off_probability: float = number(0.04, 0, 1)
    """Probability per step that a gain ends."""
    gain_sd_min: float = number(0.2, 1e-6, 1e6)
    gain_sd_max: float = number(50.0, 1e-6, 1e6)
    """A new gain is N(0, v^2) with log v uniform between these [kW]."""
    gain_decays: bool = flag(False)
    """Whether a gain decays towards 0 with a time constant that every particle has its own guess of."""
    gain_hours_min: float = number(0.3, 1e-3, 1e4)
    gain_hours_max: float = number(10.0, 1e-3, 1e4)
    """Bounds of that time constant [h], log-uniform a priori."""
    measurement_sd: float | str = option(LEARNED, _checked_measurement_sd)
    """sigma_y [K]: "learned" for each output, or a number for all of them."""
    measurement_sd_min: float = number(0.005, 1e-6, 100)
    measurement_sd_max: float = number(0.3, 1e-6, 100)
    """Bounds of a learned sigma_y [K], log-uniform a priori."""
    hyper_walk_sd: float = number(0.02, 0, 1)
    """Random walk of log sigma_y and of the log of the gain's time constant [per step]."""
    parameter_sd: float = number(0.001, 0, 1)
    """Random walk of every free log parameter [per step], times the learning gate."""
    error_hours: float = number(0.0, 0, 1000)
    """How long what the model is off by lasts [h]. Taken for news, each of its samples would make the same mistake
    about parameters surer; so log parameters take only the share period / error_hours of an update, if that is less."""
    scenarios: int = whole(1000, 8, 100_000)
    """Sampled futures that a forecast is made of at most."""


_REFERENCE_PERIOD = 600.0


_JUMP: dict[str, object] = {}
_DRIFT: dict[str, object] = {
    "process_sd": 0.003,
    "volatility": "gain",
    "gain": "always",
    "gain_walk_sd": 0.02,
    "gain_decays": True,
    "alpha_max": 250.0,
    "error_hours": 2.0,
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
    "error_hours": 2.0,
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
        "error_hours": 0.0,
    },
}
"""What differs from the defaults above, at a period of 10 minutes."""

_WALKS = ("process_sd", "volatility_sd", "gain_walk_sd", "hyper_walk_sd", "parameter_sd")
_PROBABILITIES = ("jump_probability", "gain_on_probability", "gain_off_probability")


def resolve(network: Network, period: float, given: Mapping[str, object]) -> MKFOptions:
    """The options in force: the preset at `period` s, then what is `given`.

    Raises OptionsError with one sentence naming the option.
    """
    known = {each.name: each.default for each in fields(MKFOptions)}
    check_known(given, known, "mkf")
    effective = _scaled(known | dict(PRESETS[checked_preset(given, PRESETS)]), period) | dict(given)
    return _consistent(in_force(MKFOptions, network, effective).checked())


def _scaled(options: dict[str, object], period: float) -> dict[str, object]:
    """Per-step settings of a period of 10 minutes at another `period` [s]."""
    steps = period / _REFERENCE_PERIOD
    walks = {name: float(options[name]) * sqrt(steps) for name in _WALKS}  # type: ignore[arg-type]
    chances = {name: 1.0 - (1.0 - float(options[name])) ** steps for name in _PROBABILITIES}  # type: ignore[arg-type]
    return options | walks | chances


def _consistent(options: MKFOptions) -> MKFOptions:
    check_order(options, ("measurement_sd_min", "measurement_sd_max"))
    # What is the same in every particle has bounds that are the same.
    check_order(options, ("gain_sd_min", "gain_sd_max"), ("gain_hours_min", "gain_hours_max"), equal=True)
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
