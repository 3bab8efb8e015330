"""Tables 4 to 6 and their kind: ours over seeds, the published numbers below."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from replay.experiments import published
from replay.experiments.published import Calibration
from replay.experiments.semi_synthetic.scores import DOMINATED, LOW, OVERALL, Fitted, RunScores
from replay.experiments.series.filtering import REGIMES
from replay.experiments.table import Cell, Spread, Table, spread
from replay.scores import IntervalScores

BUILDING = "building-67"
"""The network that the published numbers are about."""

Scores = Mapping[str, Sequence[RunScores]]
"""Scores over seeds, by estimator."""
Pick = Callable[[RunScores], float]


def over_seeds(runs: Sequence[RunScores], pick: Pick) -> Spread:
    """Mean and standard deviation of one figure."""
    return spread([pick(run) for run in runs])


def calibration(scores: Scores, convention: str, references: Mapping[str, Calibration]) -> Table:
    """Table 5 in one of the two conventions, "one_step" or "filtered"."""

    def row(label: str, runs: Sequence[RunScores]) -> tuple[Cell, ...]:
        def of(regime: str, score: str) -> Spread:
            return over_seeds(runs, lambda run: getattr(_intervals(run, convention)[regime], score))

        return (
            label,
            over_seeds(runs, lambda run: getattr(run, f"{convention}_rmse")),
            of(OVERALL, "winkler"),
            of(OVERALL, "coverage"),
            of(LOW, "coverage"),
            of(DOMINATED, "coverage"),
            of(OVERALL, "width"),
        )

    notes = {
        "one_step": "Interval published before y was measured, against y. With measurement noise of .15 K no honest "
        "interval can be narrower than .588 K on average.",
        "filtered": "Interval of the state after y was assimilated, against the noise-free state: the convention of "
        "the authors' runs and of the paper's Table 5. It flatters, since the estimator has seen y.",
    }
    return Table(
        f"calibration-{convention.replace('_', '-')}",
        f"Accuracy and calibration, convention {convention} (Table 5)",
        ("estimator", "RMSE, K", "Winkler, K", "coverage", "low-disturbance", "disturbance-dominated", "width, K"),
        (
            *(row(label, runs) for label, runs in scores.items()),
            *((name, *cells) for name, cells in references.items()),
        ),
        f"{notes[convention]} RMSE is against the noise-free temperature. Intervals are nominal 95 %.",
        len(references),
    )


def by_volatility(scores: Scores) -> Table:
    """`one_step` scores by the volatility regime that stood beside the interval when it was published."""
    rows: list[tuple[Cell, ...]] = []
    for label, runs in scores.items():
        for regime in REGIMES:
            of = [run.by_volatility[regime] for run in runs]
            if sum(scored.samples for scored in of):
                share = spread(
                    [scored.samples / run.one_step[OVERALL].samples for scored, run in zip(of, runs, strict=True)]
                )
                figures = [spread([getattr(scored, name) for scored in of]) for name in _SCORES]
                rows.append((label, regime, share, *figures))
    return Table(
        "calibration-by-volatility",
        "Calibration by the estimator's own regime, convention one_step",
        ("estimator", "regime", "share of samples", "coverage", "width, K", "Winkler, K"),
        tuple(rows),
        "The regime is the one published together with the interval, before y was measured: what a controller that "
        "looks at it can expect.",
    )


def transfer(learned: Mapping[str, Sequence[RunScores] | Sequence[Fitted]], network: Network) -> Table:
    """Table 4: final relative transfer-function errors, channel by channel."""
    order = [network.inputs.index(name) for name in _channels(network)]
    rows: list[tuple[Cell, ...]] = []
    for label, runs in learned.items():
        h2 = [spread([float(run.h2[channel]) for run in runs]) for channel in order]
        worst = [spread([float(run.h_infinity[channel]) for run in runs]) for channel in order]
        rows.append((label, *h2, *worst))
    if network.name == BUILDING:
        for name, values in published.H2.items():
            rows.append((name, *values, *published.H_INFINITY.get(name, (None, None, None))))
    names = [published.CHANNELS.get(name, name) for name in _channels(network)]
    return Table(
        "transfer-function-errors",
        "Relative errors of the final transfer functions (Table 4)",
        ("estimator", *(f"H2 {name}" for name in names), *(f"H∞ {name}" for name in names)),
        tuple(rows),
        "0 is the true building, 1 an error as large as the response itself. 512 frequencies from 0 to Nyquist.",
        len(rows) - len(learned),
    )


def learning(scores: Scores, network: Network) -> Table:
    """5.1.2: parasitic-learning index and what alpha tells of the disturbances."""
    picks: list[Pick] = [
        lambda run: run.update_low,
        lambda run: run.update_dominated,
        lambda run: run.parasitic_learning,
        lambda run: run.alpha_low,
        lambda run: run.alpha_dominated,
        lambda run: run.auc,
        lambda run: run.auc_settled,
    ]
    rows: list[tuple[Cell, ...]] = [
        (label, *(over_seeds(runs, pick) for pick in picks)) for label, runs in scores.items()
    ]
    alpha = (published.MEDIAN_ALPHA[LOW], published.MEDIAN_ALPHA[DOMINATED])
    quoted = published.PARASITIC_LEARNING if network.name == BUILDING else {}
    for name, index in quoted.items():
        rows.append((name, None, None, index, *(alpha if name.startswith("RBPF") else (None, None)), None, None))
    return Table(
        "parasitic-learning",
        "Parasitic learning, and alpha as a detector of disturbances (5.1.2)",
        (
            "estimator",
            "median update, quiet",
            "median update, disturbed",
            "parasitic-learning index",
            "median alpha, quiet",
            "median alpha, disturbed",
            "AUC of alpha",
            "AUC, settled",
        ),
        tuple(rows),
        "Index 1: disturbances do not speed learning up. AUC: probability that alpha is higher in a disturbed step "
        "than in a quiet one; 'settled' leaves out the hour after each beginning and end of a disturbance.",
        len(quoted),
    )


def open_loop(scores: Mapping[str, Sequence[Array]], network: Network) -> Table:
    """Table 6: open-loop RMSE over the low-disturbance segments, by estimator and seed."""
    statistics = (np.mean, np.median, np.min, np.max)
    rows: list[tuple[Cell, ...]] = [
        (label, *(spread([float(statistic(errors)) for errors in runs]) for statistic in statistics))
        for label, runs in scores.items()
        if all(len(errors) for errors in runs)
    ]
    if network.name == BUILDING:
        rows += [(name, *values) for name, values in published.OPEN_LOOP.items()]
    return Table(
        "open-loop",
        "Open-loop RMSE on low-disturbance segments of at least 12 h (Table 6), K",
        ("estimator", "mean", "median", "smallest", "largest"),
        tuple(rows),
        "Final parameters, no measurements, started at the true state, against the noise-free temperature. The true "
        "parameters do not reach 0: process noise acts on the building all the time.",
        len(published.OPEN_LOOP) if network.name == BUILDING else 0,
    )


_SCORES = ("coverage", "width", "winkler")


def _intervals(run: RunScores, convention: str) -> dict[str, IntervalScores]:
    return run.one_step if convention == "one_step" else run.filtered


def _channels(network: Network) -> list[str]:
    """Inputs in the paper's order: sun, heater, outside, then any others."""
    named = [name for name in published.CHANNELS if name in network.inputs]
    return named + [name for name in network.inputs if name not in named]
