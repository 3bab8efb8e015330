"""Parameters at a bound, parameters that the data say nothing about, and bounds that the data support."""

from collections.abc import Iterator

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.finding import AT_BOUND, NARROWER_BOUNDS, NOT_IDENTIFIED, Finding, amount
from estimator.network.boxes import boxed
from estimator.network.network import Network, Parameter
from estimator.network.presets import PRESETS, takes_box
from estimator.types import ParameterSummary

LEVELS = (0.025, 0.05, 0.5, 0.95, 0.975)
"""Levels of the summaries that all findings are read from."""

_EDGE = 0.02
"""Share of the log box that counts as its edge. A prior that learned nothing has its .05 quantile at .05, so that only
a posterior that leans against the bound comes here."""

_CROWDED = 0.1
"""The median must lie within this share of the log box as well: then most of the mass is at the bound."""

_AS_WIDE = 0.8
"""Posterior spread over that of the prior from which a parameter counts as not identified: four fifths of a log-uniform
box are what random draws from it show."""

_MARGIN = 3.0
"""Factor by which proposed bounds extend beyond the 95 % interval: one week has one weather, and intervals of a model
that is not true are too narrow."""

_WORTHWHILE = 0.5
"""Share of the log box below which proposed bounds are worth a new start."""


def at_bound(network: Network, summary: ParameterSummary) -> list[Finding]:
    """Free parameters whose posterior leans against a bound of the box; `summary` is at LEVELS."""
    findings = []
    widest = boxed(network) if takes_box(network) else network
    for parameter, place, _ in _learned(network, summary):
        _, low, median, high, _ = place
        if low <= _EDGE and median <= _CROWDED:
            end, bound = "lower", parameter.lower
        elif high >= 1.0 - _EDGE and median >= 1.0 - _CROWDED:
            end, bound = "upper", parameter.upper
        else:
            continue
        largest = widest.parameter(parameter.name)
        reaches = largest.lower < parameter.lower if end == "lower" else largest.upper > parameter.upper
        wider = ', or set box = "wide",' if reaches else ""
        sentence = (
            f"{parameter.name} is at its {end} bound of {amount(bound)} {parameter.unit}, so the true value may lie "
            f"beyond it; move {_place(network, parameter)}.{end}{wider} and start the zone anew"
        )
        findings.append(Finding(AT_BOUND, parameter.name, sentence))
    return findings


def not_identified(network: Network, summary: ParameterSummary) -> list[Finding]:
    """Free parameters about which the data say next to nothing; `summary` is at LEVELS."""
    findings = []
    for parameter, place, quantiles in _learned(network, summary):
        if place[3] - place[1] >= _AS_WIDE * (LEVELS[3] - LEVELS[1]):
            sentence = (
                f"the data do not tell {parameter.name} ({amount(quantiles[1])} to {amount(quantiles[3])} "
                f"{parameter.unit}); use no value of it, and fix it at a known value or excite the zone more, for "
                "example with a night setback"
            )
            findings.append(Finding(NOT_IDENTIFIED, parameter.name, sentence))
    return findings


def narrower_bounds(network: Network, summary: ParameterSummary, days: float) -> list[Finding]:
    """The finding that `days` days of data support narrower bounds, if they do; `summary` is at LEVELS."""
    lines = []
    for parameter, _, quantiles in _learned(network, summary):
        lower = max(quantiles[0] / _MARGIN, parameter.lower)
        upper = min(quantiles[-1] * _MARGIN, parameter.upper)
        width = np.log(upper / lower) / np.log(parameter.upper / parameter.lower)
        if width <= _WORTHWHILE:
            lines.append(f"{parameter.name} = {{ lower = {lower:.1e}, upper = {upper:.1e} }}")
    if not lines:
        return []
    sentence = (
        f"{days:.0f} days of data support narrower bounds, parameters = {{ {', '.join(lines)} }}; to adopt them, write "
        "them into the network table and start the zone anew with --reset"
    )
    return [Finding(NARROWER_BOUNDS, "zone", sentence)]


def _place(network: Network, parameter: Parameter) -> str:
    """Where the bounds of `parameter` are written in the table of `network`."""
    name = parameter.name
    if network.name in PRESETS:
        return f"parameters.{name}"
    node = next((node for node, capacitance in network.capacitances.items() if capacitance == name), None)
    if node is not None:
        return f"capacitances.{node}"
    conductances = [edge.name for edge in network.conductances]
    return f"conductances.{name}" if name in conductances else f"heat_inputs.{name}"


def _learned(network: Network, summary: ParameterSummary) -> Iterator[tuple[Parameter, Array, Array]]:
    """Every free parameter with quantiles, their places in its log box (0: lower, 1: upper bound), and themselves; no
    shares, whose bounds nobody writes."""
    shares = network.shares.values()
    for place, (parameter, quantiles) in enumerate(zip(network.parameters, summary.parameters, strict=True)):
        if parameter.free and place not in shares and np.isfinite(quantiles).all() and (quantiles > 0.0).all():
            width = np.log(parameter.upper / parameter.lower)
            yield parameter, np.log(quantiles / parameter.lower) / width, quantiles
