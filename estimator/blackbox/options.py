"""Options of the online ARX model, of the one on changes since the day before, and of the direct regressions."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from estimator.errors import OptionsError
from estimator.network.network import Network
from estimator.option_checks import check_known, checked_number

_MEMORY_DAYS = 60.0


@dataclass(frozen=True)
class ARXOptions:
    """Everything the model can be told."""

    past_outputs: int = 6
    """Past values of the output in a regression."""
    past_inputs: int = 3
    """Past values of every input, that of the step itself among them."""
    memory_days: float = _MEMORY_DAYS
    """Time constant with which old samples are forgotten [d]."""
    verified_memory_days: float = 20.0
    """The same for the verified errors from which the spread of a forecast follows [d]."""


@dataclass(frozen=True)
class DirectOptions:
    """Everything the direct regressions can be told."""

    memory_days: float = _MEMORY_DAYS
    """Time constant with which old samples are forgotten [d]."""
    verified_memory_days: float = 20.0
    """The same for verified forecasts, from which trust and spread follow [d]."""
    penalty_days: float = 0.2
    """Days of samples that speak for persistence."""
    blind: bool = False
    """Whether inputs to come are left out: for forecasts that need no plan, and where they mislead."""


_RANGES = {
    "penalty_days": (1e-6, 1e6),
    "past_outputs": (1, 48),
    "past_inputs": (1, 48),
    "memory_days": (0.1, 1e6),
    "verified_memory_days": (0.1, 1e6),
}
_WHOLE = ("past_outputs", "past_inputs")


def resolve(network: Network, period: float, given: Mapping[str, object]) -> ARXOptions:
    """The options in force; OptionsError with one sentence naming the option that is wrong."""
    return _resolve("arx", {}, given)


def resolve_daily(network: Network, period: float, given: Mapping[str, object]) -> ARXOptions:
    """The same for changes since the day before, which hold little that more of the past could tell."""
    return _resolve("daily", {"past_outputs": 1, "past_inputs": 1}, given)


def resolve_direct(network: Network, period: float, given: Mapping[str, object]) -> DirectOptions:
    """The options in force; OptionsError with one sentence naming the option that is wrong."""
    check_known(given, {field.name for field in fields(DirectOptions)}, "direct")
    blind = given.get("blind", False)
    if not isinstance(blind, bool):
        raise OptionsError(f"blind = {blind!r} must be true or false", "blind")
    return DirectOptions(**_checked({name: value for name, value in given.items() if name != "blind"}), blind=blind)


def _resolve(estimator: str, preset: Mapping[str, object], given: Mapping[str, object]) -> ARXOptions:
    check_known(given, {field.name for field in fields(ARXOptions)}, estimator)
    return ARXOptions(**_checked(dict(preset) | dict(given)))


def _checked(given: Mapping[str, object]) -> dict[str, Any]:
    return {name: checked_number(name, value, *_RANGES[name], whole=name in _WHOLE) for name, value in given.items()}
