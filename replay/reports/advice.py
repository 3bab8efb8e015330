"""What to change in the configuration, from findings, skill and residuals. Every sentence names a key or a command."""

from collections.abc import Iterator

import numpy as np

from estimator.diagnosis.finding import AGAINST_BALANCE, MISSES_SOMETHING
from replay.localtime import HOUR
from replay.recorded.trace import Trace
from replay.reports.kit.document import Document
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
    document = Document(__package__)
    if any(one.finding in (AGAINST_BALANCE, MISSES_SOMETHING) for one in trace.diagnosis.findings):
        sentences += document.lines("Another network")
    for heading, values in (*_from_skill(trace), *_from_intervals(trace), *_from_residuals(trace, found)):
        sentences += document.lines(heading, **values)
    return sentences or list(document.lines("Nothing to change"))


Said = Iterator[tuple[str, dict[str, object]]]


def _from_skill(trace: Trace) -> Said:
    judged = [one for one in horizons(trace) if one.forecasts >= ENOUGH]
    for name, heading in (
        ("skill_against_persistence", "Worse than persistence"),
        ("skill_against_arx", "Worse than a regression"),
    ):
        worse = [one for one in judged if getattr(one, name) < _WORSE]
        if worse and not (name == "skill_against_arx" and trace.estimator in ("arx", "bank")):
            leads = (f"{ahead(trace, one)} ({-100 * getattr(one, name):.0f} %)" for one in worse)
            yield heading, {"leads": " and ".join(leads)}


def _from_intervals(trace: Trace) -> Said:
    y, mean, lower, upper = (
        np.array([getattr(row, name) for row in trace.rows]) for name in ("y", "mean", "lower", "upper")
    )
    error, share = rmse(y - mean), coverage(y, lower, upper)
    if np.isfinite(y - mean).sum() < ENOUGH:
        return
    noise, held = trace.options.get("measurement_sd"), {"share": 100 * share, "level": 100 * trace.level}
    if isinstance(noise, float) and noise > error and share > trace.level + _TOO_MANY:
        yield "Too wide", {**held, "noise": noise, "error": error}
    elif share < trace.level - _TOO_FEW:
        remedy = (
            f"raise `process_sd` (now {trace.options['process_sd']:.2g} K per step)"
            if isinstance(trace.options.get("process_sd"), float)
            else 'set `estimator = "bank"`, which keeps its coverage'
        )
        yield "Too narrow", {**held, "remedy": remedy}


def _from_residuals(trace: Trace, found: Diagnostics) -> Said:
    if len(found.pit) < ENOUGH:
        return
    first, least = float(found.autocorrelation[0]), max(_FOLLOWS, found.band)
    if abs(first) > least:
        yield "Memory", {"correlation": first}
    for channel, values in found.against_inputs.items():
        if np.isfinite(values).any() and abs(values[lag := int(np.nanargmax(np.abs(values)))]) > least:
            yield "An input", {"channel": channel, "correlation": values[lag], "hours": lag * trace.period / HOUR}
