"""Options of the online ARX model, of the one on changes since the day before, and of the direct regressions."""

from dataclasses import dataclass

from estimator.option_checks import flag, number, resolver, whole


@dataclass(frozen=True)
class ARXOptions:
    """Everything the model can be told."""

    past_outputs: int = whole(6, 1, 48)
    """Past values of the output in a regression."""
    past_inputs: int = whole(3, 1, 48)
    """Past values of every input, that of the step itself among them."""
    memory_days: float = number(60.0, 0.1, 1e6)
    """Time constant with which old samples are forgotten [d]."""
    verified_memory_days: float = number(20.0, 0.1, 1e6)
    """The same for the verified errors from which the spread of a forecast follows [d]."""


@dataclass(frozen=True)
class DirectOptions:
    """Everything the direct regressions can be told."""

    memory_days: float = number(60.0, 0.1, 1e6)
    """Time constant with which old samples are forgotten [d]."""
    verified_memory_days: float = number(20.0, 0.1, 1e6)
    """The same for verified forecasts, from which trust and spread follow [d]."""
    penalty_days: float = number(0.2, 1e-6, 1e6)
    """Days of samples that speak for what it begins as."""
    blind: bool = flag(False)
    """Whether inputs to come are left out: for forecasts that need no plan, and where they mislead."""


resolve = resolver(ARXOptions, "arx")
resolve_daily = resolver(ARXOptions, "daily", lambda *_: {"past_outputs": 1, "past_inputs": 1})
"""Of changes since the day before, which hold little that more of the past could tell."""
resolve_direct = resolver(DirectOptions, "direct")
