"""The tables of the hours-ahead report."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from replay.experiments.hours_ahead.horizons import THREE_DAYS
from replay.experiments.hours_ahead.outcome import Outcome
from replay.experiments.hours_ahead.scores import overlapping
from replay.experiments.hours_ahead.verdicts import crps_spread, free_intervals, values
from replay.experiments.table import Cell, Spread, Table, spread

_FIGURES = {
    "RMSE, K": "rmse",
    "CRPS, K": "crps",
    "coverage": "coverage",
    "width, K": "width",
    "Winkler, K": "winkler",
}

_LEARNED = {
    "heat loss over the true one": "heat_loss",
    "rms error of the gain over its rms": "gain_error",
    "the same of hourly means": "hourly_error",
    "the same without sun": "dark_error",
    "coverage of the gain's 95 % interval": "gain_coverage",
    "area under the ROC curve of P(on)": "on",
}


def by_recording(outcomes: Sequence[Outcome], figure: str, title: str, window: str = THREE_DAYS) -> Table:
    """One figure of `Scores`: a row for every recording and horizon, a column for every rival."""
    labels = list(outcomes[0].scores[window])
    rows: list[tuple[Cell, ...]] = []
    for outcome in outcomes:
        for horizon in outcome.leads:
            cells = [_over_seeds(outcome, label, horizon, figure, window) for label in labels]
            if any(cell is not None for cell in cells):
                rows.append((outcome.recording.name, horizon, *cells))
    shown = labels if figure == "crps" else [label for place, label in enumerate(labels) if _any(rows, place + 2)]
    kept = [0, 1, *(labels.index(label) + 2 for label in shown)]
    return Table(
        slug(f"{figure} {window}"),
        f"{title}, {window}",
        ("recording", "ahead", *shown),
        tuple(tuple(row[place] for place in kept) for row in rows),
    )


def in_full(outcome: Outcome, window: str = THREE_DAYS) -> Table:
    """Every score of one recording."""
    rows: list[tuple[Cell, ...]] = []
    for horizon in outcome.leads:
        for label in outcome.scores[window]:
            cells = [_over_seeds(outcome, label, horizon, figure, window) for figure in _FIGURES.values()]
            samples = int(values(outcome, label, horizon, "samples", window).min())
            rows.append((horizon, label, samples, *cells))
    return Table(
        slug(f"scores {outcome.recording.name} {window}"),
        f"{outcome.recording.name}: all scores, {window}",
        ("ahead", "forecast", "forecasts scored", *_FIGURES),
        tuple(rows),
        "Intervals are nominal 95 %. A point forecast has none; its CRPS is its mean absolute error.",
    )


def ranking(standings: Sequence[tuple[str, float, float, str]]) -> Table:
    """Who is how far behind the best of all, over all recordings and horizons (`ranked`)."""
    return Table(
        "ranking",
        f"CRPS over that of the best forecast of all, {THREE_DAYS}",
        ("forecast", "geometric mean", "worst", "where it is worst"),
        tuple(standings),
        "1 would be the best everywhere. The best is chosen afterwards for every recording and horizon.",
    )


def ranked(outcomes: Sequence[Outcome]) -> list[tuple[str, float, float, str]]:
    """Label, geometric mean and largest of CRPS over the smallest of all, and where; the best label first."""
    found: dict[str, dict[str, float]] = {label: {} for label in outcomes[0].scores[THREE_DAYS]}
    for outcome in outcomes:
        for horizon in outcome.leads:
            means = {label: float(values(outcome, label, horizon, "crps").mean()) for label in found}
            best = np.nanmin([*means.values(), np.inf])
            for label, crps in means.items():
                if np.isfinite(crps) and 0.0 < best < np.inf:
                    found[label][f"{outcome.recording.name}, {horizon}"] = crps / float(best)
    standings = [
        (
            label,
            float(np.exp(np.mean(np.log(list(cells.values()))))),
            max(cells.values()),
            max(cells, key=cells.__getitem__),
        )
        for label, cells in found.items()
        if cells
    ]
    return sorted(standings, key=lambda standing: standing[1])


def seeds_compared(outcomes: Sequence[Outcome]) -> Table:
    """Do several seeds of an estimator agree?"""
    rows: list[tuple[Cell, ...]] = []
    for outcome in outcomes:
        parameters = [parameter.name for parameter in outcome.recording.network.free]
        for label, quantiles in outcome.parameters.items():
            if len(quantiles) > 1:
                spreads = [crps_spread(outcome, label, horizon) for horizon in outcome.leads]
                agree: tuple[Cell, Cell] = (None, None)
                if np.isfinite(quantiles).all():
                    together = overlapping(free_intervals(outcome, label))
                    apart = [name for name, same in zip(parameters, together, strict=True) if not same]
                    agree = (f"{together.sum()} of {len(together)}", ", ".join(apart) or None)
                rows.append((outcome.recording.name, label, *_first_and_largest(spreads), *agree))
    return Table(
        "seeds",
        f"Do seeds agree? {THREE_DAYS}",
        (
            "recording",
            "estimator",
            "spread of CRPS, first horizon",
            "largest spread of CRPS",
            "parameters with overlapping intervals",
            "parameters without",
        ),
        tuple(rows),
        "Spread: standard deviation over seeds as a share of the mean. Intervals: 95 %, at the end of the record.",
    )


def against_truth(outcomes: Sequence[Outcome]) -> Table:
    """What the estimators have learned, against the simulator."""
    rows: list[tuple[Cell, ...]] = []
    for outcome in outcomes:
        for label, runs in outcome.learned.items():
            figures = [[getattr(run, name) for run in runs] for name in _LEARNED.values()]
            cells = [spread(found) if np.isfinite(found).all() else None for found in figures]
            if any(cell is not None for cell in cells):
                rows.append((outcome.recording.name, label, *cells))
    return Table(
        "truth",
        "What was learned after three weeks, against EnergyPlus",
        ("recording", "estimator", *_LEARNED),
        tuple(rows),
        "Heat loss: the learned one over that of a co-heating test in EnergyPlus; 1 is right. Gain: unmeasured heat in "
        "the week after; an error of 0 is right, and that of saying that there is none is 1. P(on): 0.5 is chance.",
    )


def slug(text: str) -> str:
    """`text` as the name of a file."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")


def _first_and_largest(spreads: Sequence[float]) -> tuple[Cell, Cell]:
    known = [value for value in spreads if np.isfinite(value)]
    return (known[0], max(known)) if known else (None, None)


def _over_seeds(outcome: Outcome, label: str, horizon: str, figure: str, window: str) -> Spread | None:
    found = values(outcome, label, horizon, figure, window)
    return spread(found.tolist()) if len(found) and np.isfinite(found).all() else None


def _any(rows: Sequence[tuple[Cell, ...]], place: int) -> bool:
    return any(row[place] is not None for row in rows)
