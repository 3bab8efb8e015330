"""All findings about one zone at once, and when it is time to look for them."""

from typing import Any

import numpy as np

from estimator.arrays import Array
from estimator.bank.bank import Bank
from estimator.diagnosis.balance import against_balance, known_heat
from estimator.diagnosis.finding import Diagnosis, Finding
from estimator.diagnosis.forecasts import implausible
from estimator.diagnosis.members import carried, disagreement, variants
from estimator.diagnosis.parameters import LEVELS, at_bound, narrower_bounds, not_identified
from estimator.diagnosis.record import Record, recorded_days
from estimator.diagnosis.sky import taken_for_clear
from estimator.diagnosis.telemetry.recent import Recent
from estimator.diagnosis.thermostat import disobedience
from estimator.network.network import Network
from estimator.statespace.inverse import Driving
from estimator.thermostat.thermostat import Thermostat
from estimator.types import Estimator, ParameterSummary

EVERY = 6 * 3600
"""s between two diagnoses. Quantiles of thousands of particles cost tens of ms, and findings change over days."""

SETTLED_DAYS = 3.0
"""Days of data before anything is said about parameters and members: earlier, nothing being known is no finding."""

PROPOSAL_DAYS = 7.0
"""Days of data before bounds are proposed: a week has working days, a weekend and more than one weather."""

_MORE_POWER = 1.5
"""Factor by which the largest heating must grow for a diagnosis out of turn: the first heating is such a time."""


def due(network: Network, before: Record, after: Record, time: int, period: int, seed: int, every: int = EVERY) -> bool:
    """Whether the sample at `time` [UTC s], which took the record from `before` to `after`, calls for a diagnosis.

    That depends on the samples alone, so that a zone that is restored finds the same at the same samples. `seed`
    spreads the zones of a site over the s that pass between two: `every`.
    """
    phase = seed % every
    if (time + phase) // every != (time + period + phase) // every:
        return True
    more = after.largest > _MORE_POWER * before.largest
    return bool(more.any()) and any(more[network.inputs.index(channel)] for channel in known_heat(network))


def diagnose(
    estimator: Estimator,
    state: Any,
    record: Record,
    inputs: Array,
    *,
    thermostat: Thermostat,
    recent: Recent,
    driving: Driving,
    proposes_bounds: bool = False,
) -> Diagnosis:
    """Every finding about `state`, with the zone's `record`, the `inputs` (n_u,) in force, what is known of its
    `thermostat`, what was measured in the `recent` fortnight, and what was `driving` the zone then. Nothing is changed.

    With `proposes_bounds` narrower bounds are proposed once there is a week of data.
    """
    days = recorded_days(record)
    findings = disobedience(estimator.network, thermostat)
    findings += implausible(estimator, state, inputs, record.largest)
    bank = estimator if isinstance(estimator, Bank) else None
    if days >= SETTLED_DAYS:
        if estimator.physical:
            summary = estimator.parameters(state, np.array(LEVELS))
            findings += _of_parameters(estimator.network, summary, record, days, proposes_bounds)
            heat_loss = float(summary.heat_loss[len(LEVELS) // 2])
            findings += taken_for_clear(estimator, state, heat_loss, recent, driving)
        if bank is not None:
            findings += disagreement(bank, state, LEVELS) + carried(bank, state)
    return Diagnosis(tuple(findings), variants(bank, state) if bank is not None else ())


def _of_parameters(
    network: Network, summary: ParameterSummary, record: Record, days: float, proposes_bounds: bool
) -> list[Finding]:
    # Bounds are proposed from a model that fits: one that leans against a bound has put its errors into the others.
    misfits = against_balance(network, summary, record) + at_bound(network, summary)
    proposals = []
    if proposes_bounds and days >= PROPOSAL_DAYS and not misfits:
        proposals = narrower_bounds(network, summary, days)
    return misfits + not_identified(network, summary) + proposals
