"""From a horizon and planned inputs to the steps and rows that a zone forecasts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from estimator.network.network import Network
from service.fields.durations import format_duration
from service.web.control.planning import Limits, beyond
from service.web.models import MAX_STEPS
from service.web.problems import invalid

MAX_INTERVALS = 4032
"""Intervals in one fan: steps times levels; each is a root-finding over all particles."""

_ROUNDING = 1e-6


def steps_in(horizon: float, period: float, levels: int) -> int:
    """How many periods (s) make up `horizon` (s); RequestRefused if none, no whole number, or too many.

    Too many also with the number of `levels` that each step is to have.
    """
    steps = round(horizon / period)
    if steps < 1 or abs(steps * period - horizon) > _ROUNDING:
        near = format_duration(max(1, steps) * period)
        raise invalid(
            [
                f"horizon {format_duration(horizon)} is not a whole number of the zone's periods of "
                f"{format_duration(period)}; {near} would be"
            ]
        )
    if steps > MAX_STEPS:
        raise invalid(
            [
                f"horizon {format_duration(horizon)} has {steps} steps of {format_duration(period)}; "
                f"at most {MAX_STEPS} are forecast at once, that is {format_duration(MAX_STEPS * period)}"
            ]
        )
    if steps * levels > MAX_INTERVALS:
        raise invalid(
            [
                f"{steps} steps with {levels} levels each are too many; "
                f"at most {MAX_INTERVALS} intervals are given at once"
            ]
        )
    return steps


def full_plan(
    inputs: Mapping[str, float | Sequence[float]], network: Network, steps: int, period: float, limits: Limits
) -> dict[str, list[float]]:
    """`steps` values for every channel of `inputs`, within `limits`; RequestRefused with one sentence per mistake."""
    mistakes = []
    plan = {}
    for channel, values in inputs.items():
        if channel not in network.inputs:
            mistakes.append(
                f"field 'inputs.{channel}' is not an input of this zone; its inputs are {', '.join(network.inputs)}"
            )
        elif isinstance(values, int | float):
            plan[channel] = [float(values)] * steps
        elif len(values) != steps:
            mistakes.append(
                f"field 'inputs.{channel}' has {len(values)} values, but the horizon has {steps} steps of "
                f"{format_duration(period)}; give {steps} values, or one number for all"
            )
        else:
            plan[channel] = [float(value) for value in values]
    for channel, planned in plan.items():
        if (why := beyond(planned, channel, network, limits)) is not None:
            mistakes.append(f"field 'inputs.{channel}' {why}")
    if mistakes:
        raise invalid(mistakes)
    return plan
