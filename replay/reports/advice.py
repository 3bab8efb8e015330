"""What to change in the configuration, from findings, skill and residuals. Every sentence names a key or a command."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from replay.localtime import HOUR
from replay.recorded.trace import Trace
from replay.reports.residuals import Diagnostics
from replay.reports.tables import ahead, horizons
from replay.scores.intervals import coverage, rmse

ENOUGH = 48
"""Verified forecasts before their skill says anything: two days of one an hour."""

_WORSE = -0.05
"""Skill below which another forecast counts as better."""
_TOO_FEW, _TOO_MANY = 0.05, 0.03
"""How far coverage may lie below and above its level."""
_FOLLOWS = 0.3
"""Correlation of residuals that explains about a tenth of their variance: less is not worth a change."""


def advice(trace: Trace, found: Diagnostics) -> list[str]:
    """Sentences, the findings first; one that says so where there is nothing to change."""
    # A sentence may begin with the name of a parameter, so it keeps its small letter.
    sentences = [f"`{finding.finding}`: {finding.sentence}." for finding in trace.diagnosis.findings]
    sentences += [*_from_skill(trace), *_from_intervals(trace), *_from_residuals(trace, found)]
    return sentences or ["Nothing: there is no finding, and forecasts and intervals are what they should be."]


def _from_skill(trace: Trace) -> Iterator[str]:
    judged = [one for one in horizons(trace) if one.forecasts >= ENOUGH]
    for name, other, remedy in (
        ("skill_against_persistence", "a forecast that nothing changes", _NETWORK),
        ("skill_against_arx", "a linear regression that knows no physics", _BANK),
    ):
        worse = [one for one in judged if getattr(one, name) < _WORSE]
        if worse and not (name == "skill_against_arx" and trace.estimator in ("arx", "bank")):
            leads = " and ".join(f"{ahead(trace, one)} ({-100 * getattr(one, name):.0f} %)" for one in worse)
            yield f"Compared with {other}, the RMSE is larger at {leads}; {remedy}."


_NETWORK = (
    "settle the findings first, then see with `thermogate experiment topology` whether another network serves the zone "
    "better"
)
_BANK = 'set `estimator = "bank"`, which weighs such a regression with physical models at every horizon'


def _from_intervals(trace: Trace) -> Iterator[str]:
    y, mean, lower, upper = (
        np.array([getattr(row, name) for row in trace.rows]) for name in ("y", "mean", "lower", "upper")
    )
    error, share = rmse(y - mean), coverage(y, lower, upper)
    if np.isfinite(y - mean).sum() < ENOUGH:
        return
    noise = trace.options.get("measurement_sd")
    where = f"{100 * share:.1f} % of the {100 * trace.level:g} % intervals one step ahead held the measurement"
    if isinstance(noise, float) and noise > error and share > trace.level + _TOO_MANY:
        yield (
            f"{where}, so they are too wide: `measurement_sd = {noise:g}` K is more than the whole error of the "
            f'forecasts; set it to at most {error:.2g}, or `estimator = "mkf"`, which learns it.'
        )
    elif share < trace.level - _TOO_FEW:
        remedy = (
            f"raise `process_sd` (now {trace.options['process_sd']:.2g} K per step)"
            if isinstance(trace.options.get("process_sd"), float)
            else 'set `estimator = "bank"`, which keeps its coverage'
        )
        yield f"{where}, so they are too narrow; {remedy}."


def _from_residuals(trace: Trace, found: Diagnostics) -> Iterator[str]:
    first = float(found.autocorrelation[0]) if len(found.pit) >= ENOUGH else np.nan
    if abs(first) > max(_FOLLOWS, found.band):
        yield (
            f"An error of one step predicts the next (correlation {first:+.2f}): the network misses something that "
            "lasts; see with `thermogate experiment topology` whether another network does better."
        )
    for channel, values in found.against_inputs.items():
        if len(found.pit) < ENOUGH or not np.isfinite(values).any():
            continue
        lag = int(np.nanargmax(np.abs(values)))
        if abs(values[lag]) > max(_FOLLOWS, found.band):
            yield (
                f"The errors follow `{channel}` (correlation {values[lag]:+.2f} after "
                f"{lag * trace.period / HOUR:.2g} h): check its unit and scale, and the way that it takes through the "
                "network."
            )
