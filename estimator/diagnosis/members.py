"""Where the members of a bank disagree, and which variant of the network they trust."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.bank.bank import Bank
from estimator.diagnosis.finding import (
    MEMBERS_DISAGREE,
    MISSES_SOMETHING,
    OTHER_VARIANT,
    Finding,
    VariantWeight,
    amount,
)
from estimator.network.family import family
from estimator.network.network import Network
from estimator.types import Estimator

_COUNTS = 0.05
"""Weight that a member must have at some horizon for its parameters to count: below that nobody relies on it."""

_MOST = 0.5
"""Share of the weight from which black boxes, or a variant, carry the forecast."""


class _Member(NamedTuple):
    name: str
    estimator: Estimator
    state: Any
    weights: Array
    """(H,)."""


def disagreement(bank: Bank, state: Any, levels: Sequence[float]) -> list[Finding]:
    """Parameters, and the heat loss, of which two members are sure in different places; `levels` begin and end with the
    ends of their intervals. Members with another network than the bank's mean something else and are left out."""
    summaries = {
        member.name: member.estimator.parameters(member.state, np.array(levels))
        for member, plans in zip(_members(bank, state), bank.plans, strict=True)
        if plans and member.estimator.network == bank.network and member.weights.max() >= _COUNTS
    }
    found = []
    for index, parameter in enumerate(bank.network.parameters):
        if parameter.free:
            rows = {name: summary.parameters[index] for name, summary in summaries.items()}
            found += _apart(parameter.name, parameter.unit, rows)
    return found + _apart("heat_loss", "W/K", {name: summary.heat_loss for name, summary in summaries.items()})


def variants(bank: Bank, state: Any) -> tuple[VariantWeight, ...]:
    """The variants of the bank's network that its members have, with their weights a few hours ahead; empty if all
    members have the same network. Black boxes have no network, and their weight is left out."""
    known = family(bank.network)
    weights = dict.fromkeys(known, 0.0)
    for member in _members(bank, state):
        name = next((name for name, network in known.items() if network == member.estimator.network), None)
        if member.estimator.physical and name is not None:
            weights[name] += float(member.weights[bank.compared])
    used = {
        name
        for name, network in known.items()
        if any(each.physical and each.network == network for each in bank.members)
    }
    total = sum(weights.values())
    if len(used) < 2 or total <= 0.0:
        return ()
    return tuple(VariantWeight(name, weights[name] / total) for name in known if name in used)


def carried(bank: Bank, state: Any) -> list[Finding]:
    """The findings that black boxes, or another variant than the bank's own network, carry the forecast hours ahead."""
    hours = bank.leads[bank.compared] * bank.period / 3600.0
    # By what they have proved: the weights a priori say nothing of this building.
    earned = bank.earned_weights(state).values()
    blind = sum(float(own[bank.compared]) for own, one in zip(earned, bank.members, strict=True) if not one.physical)
    findings = []
    if blind > _MOST:
        problem = (
            f"most of the forecast {hours:.0f} h ahead follows the habits of the room, not its building, so something "
            "acts on it that is not measured"
        )
        absent = _absent(bank.network)
        remedy = f"measure {absent} as well" if absent else "measure what else heats or cools it, such as ventilation"
        findings.append(Finding(MISSES_SOMETHING, "zone", f"{problem}; {remedy}"))
    for one in variants(bank, state):
        if one.variant != "own" and one.weight > _MOST:
            sentence = (
                f"the variant '{one.variant}' of the network carries {100 * one.weight:.0f} % of the forecast "
                f"{hours:.0f} h ahead; read parameters and heat loss as those of this variant"
            )
            findings.append(Finding(OTHER_VARIANT, one.variant, sentence))
    return findings


def _absent(network: Network) -> str:
    """What acts on most rooms and has no channel in `network`; empty if there is nothing."""
    sun, heating = (any(heat.unit == unit for heat in network.heat_inputs) for unit in ("W/m2", "W"))
    known = {"the heating": heating, "the sun": sun, "the rooms next door": len(network.boundaries) > 1}
    absent = [name for name, there in known.items() if not there]
    return " and ".join(filter(None, (", ".join(absent[:-1]), *absent[-1:])))


def _members(bank: Bank, state: Any) -> list[_Member]:
    weights = bank.member_weights(state).values()
    return [_Member(*each) for each in zip(bank.names, bank.members, state.members, weights, strict=True)]


def _apart(subject: str, unit: str, rows: Mapping[str, Array]) -> list[Finding]:
    """The finding that two of the intervals in `rows`, from their first to their last entry with the median in the
    middle, do not overlap."""
    known = {name: row for name, row in rows.items() if np.isfinite(row).all()}
    if len(known) < 2:
        return []
    above = max(known, key=lambda name: float(known[name][0]))
    below = min(known, key=lambda name: float(known[name][-1]))
    if known[above][0] <= known[below][-1]:
        return []
    first, second = (amount(known[name][len(known[name]) // 2]) for name in (below, above))
    lowest, highest = (float(end([row[place] for row in known.values()])) for end, place in ((min, 0), (max, -1)))
    values = "heat losses" if subject == "heat_loss" else f"values of {subject}"
    sentence = (
        f"two ways of looking at this room give different {values}, {first} and {second} {unit}; treat it as "
        f"{amount((lowest + highest) / 2.0)} +- {amount((highest - lowest) / 2.0)} {unit}"
    )
    return [Finding(MEMBERS_DISAGREE, subject, sentence)]
