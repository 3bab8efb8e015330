"""What the bank is held to, checked by the numbers of a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.arrays import Array
from replay.experiments.hours_ahead.horizons import ONE_STEP, THREE_DAYS
from replay.experiments.hours_ahead.outcome import Outcome
from replay.experiments.hours_ahead.rivals import BANK, MKF, RBPF
from replay.experiments.hours_ahead.scores import overlapping
from replay.experiments.verdict import Verdict, at_least, at_most, between

OVER_BEST = 1.02
COVERAGE = (0.93, 0.97)
OVER_RBPF = 0.7
WINKLER_OVER_RBPF = 0.6
SPREAD = 0.03
HEAT_LOSS_OFF, GAIN_OFF = 0.2, 0.25
"""Shares by which what was learned of a building of EnergyPlus may be off."""


def values(outcome: Outcome, label: str, horizon: str, figure: str, window: str = THREE_DAYS) -> Array:
    """One figure of `Scores` for every seed of a rival; NaN where nothing was scored."""
    runs = outcome.scores[window].get(label, ())
    return np.array([getattr(run[horizon], figure) for run in runs if horizon in run])


def best_rival(outcome: Outcome, horizon: str, window: str = THREE_DAYS) -> tuple[str, float]:
    """Who but the bank has the smallest CRPS [K], mean over seeds, and how small; NaN where nobody was scored."""
    found = {
        label: float(values(outcome, label, horizon, "crps", window).mean())
        for label in outcome.scores[window]
        if label != BANK
    }
    known = {label: crps for label, crps in found.items() if np.isfinite(crps)}
    return min(known.items(), key=lambda item: item[1]) if known else ("nobody", float("nan"))


def verdicts(outcomes: Sequence[Outcome]) -> list[Verdict]:
    """Every target of the bank. A target takes several seeds, or a measured room, only where there are some."""
    return [
        *(verdict for outcome in outcomes for verdict in _against_the_best(outcome)),
        *(verdict for outcome in outcomes for verdict in _coverage(outcome)),
        *_against_the_rbpf(outcomes),
        *(verdict for outcome in outcomes for verdict in _over_seeds(outcome)),
        *(verdict for outcome in outcomes for verdict in against_the_truth(outcome)),
    ]


def _against_the_best(outcome: Outcome) -> list[Verdict]:
    found = []
    for horizon in outcome.leads:
        label, best = best_rival(outcome, horizon)
        target = f"{outcome.recording.name}, {horizon}: CRPS of the bank over that of the best rival, {label}"
        found.append(at_most(target, (values(outcome, BANK, horizon, "crps") / best).tolist(), OVER_BEST))
    return found


def _coverage(outcome: Outcome) -> list[Verdict]:
    return [
        between(
            f"{outcome.recording.name}, {horizon}: coverage of the bank",
            values(outcome, BANK, horizon, "coverage").tolist(),
            *COVERAGE,
        )
        for horizon in outcome.leads
    ]


def _against_the_rbpf(outcomes: Sequence[Outcome]) -> list[Verdict]:
    measured = [outcome for outcome in outcomes if outcome.recording.measured]
    return [
        *(
            at_most(
                f"{horizon}: CRPS of the bank over that of {RBPF}, mean over recordings",
                _mean_ratio(outcomes, horizon, "crps"),
                OVER_RBPF,
            )
            for horizon in ("6 h", "24 h")
        ),
        at_most(
            f"{ONE_STEP}: Winkler score of the bank over that of {RBPF}, mean over measured rooms",
            _mean_ratio(measured, ONE_STEP, "winkler"),
            WINKLER_OVER_RBPF,
        ),
    ]


def _mean_ratio(outcomes: Sequence[Outcome], horizon: str, figure: str) -> list[float]:
    """Bank over RBPF, each the mean over seeds, averaged over `outcomes`; nothing where there are none."""
    ratios = [
        float(values(outcome, BANK, horizon, figure).mean() / values(outcome, RBPF, horizon, figure).mean())
        for outcome in outcomes
        if horizon in outcome.leads
    ]
    return [float(np.mean(ratios))] if ratios else []


def _over_seeds(outcome: Outcome) -> list[Verdict]:
    name, seeds = outcome.recording.name, len(outcome.scores[THREE_DAYS][BANK])
    shares = [float(overlapping(free_intervals(outcome, BANK)).mean())] if seeds > 1 else []
    spreads = [crps_spread(outcome, BANK, horizon) for horizon in outcome.leads] if seeds > 1 else []
    return [
        at_least(f"{name}: share of the bank's parameters whose 95 % intervals overlap over seeds", shares, 1.0),
        at_most(
            f"{name}: CRPS of the bank, sd over seeds as a share of the mean, worst horizon", _worst(spreads), SPREAD
        ),
    ]


def against_the_truth(outcome: Outcome) -> list[Verdict]:
    """Of the physical models that a user would take."""
    name, known = outcome.recording.name, outcome.learned
    return [
        *(
            between(
                f"{name}: heat loss of {label} after three weeks, over the true one",
                [run.heat_loss for run in known[label]],
                1.0 - HEAT_LOSS_OFF,
                1.0 + HEAT_LOSS_OFF,
            )
            for label in (RBPF, MKF, BANK)
            if label in known
        ),
        *(
            at_most(
                f"{name}: rms error of the gain of {label} after three weeks, over its rms",
                [run.gain_error for run in known[label]],
                GAIN_OFF,
            )
            for label in (MKF, BANK)
            if label in known
        ),
    ]


def free_intervals(outcome: Outcome, label: str) -> Array:
    """The final 95 % intervals (seeds, d, 2) of the free parameters."""
    free = [place for place, parameter in enumerate(outcome.recording.network.parameters) if parameter.free]
    return np.asarray(outcome.parameters[label][:, free][:, :, [0, 2]])


def crps_spread(outcome: Outcome, label: str, horizon: str) -> float:
    """Standard deviation of the CRPS over at least two seeds, as a share of its mean."""
    crps = values(outcome, label, horizon, "crps")
    return float(crps.std(ddof=1) / crps.mean())


def _worst(found: Sequence[float]) -> list[float]:
    known = [value for value in found if np.isfinite(value)]
    return [max(known)] if known else []
