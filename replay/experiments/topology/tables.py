"""The tables of the topology experiment, the paper's own rows among them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from replay.experiments.jobs import Arrays
from replay.experiments.topology.published import TABLE_3
from replay.experiments.topology.ranking import Fitted
from replay.reports.kit.table import Cell, Table

COLUMNS: Mapping[str, Callable[[Fitted], Cell]] = {
    "network": lambda entry: entry.candidate.label,
    "sun": lambda entry: _yes(entry.candidate.solar),
    "states": lambda entry: len(entry.candidate.network.nodes),
    "free parameters": lambda entry: len(entry.candidate.network.free),
    "train RMSE [K]": lambda entry: entry.scores.train_rmse,
    "full MAE [K]": lambda entry: entry.scores.full_mae,
    "night MAE [K]": lambda entry: entry.scores.night_mae,
    "day MAE [K]": lambda entry: entry.scores.day_mae,
    "held-out RMSE [K]": lambda entry: entry.scores.held_out_rmse,
    "J_acf": lambda entry: entry.scores.j_acf,
    "its term at 6 h": lambda entry: entry.scores.j_acf_last,
    "loss [%]": lambda entry: 100.0 * entry.loss,
    "parameters at a bound": lambda entry: ", ".join(entry.at_bound) or "none",
}


def ranking(name: str, ranked: Sequence[Fitted], paper: bool) -> Table:
    """Table 3 for a recording, the network to take first; with the `paper`'s rows below where it is its building."""
    quoted = [
        (f"{label}, paper", _yes(solar), states, None, *errors, None, None, last, None, None)
        for label, solar, states, *errors, last in (TABLE_3 if paper else ())
    ]
    return Table(
        f"ranking-{name}",
        f"Candidates, {name}",
        tuple(COLUMNS),
        (*(tuple(cell(entry) for cell in COLUMNS.values()) for entry in ranked), *quoted),
        "The first row is the network to take, the others follow by loss: how far train RMSE, night MAE and "
        "held-out RMSE lie above the best candidate in each, on geometric average."
        + (
            " The paper's J_acf stands under the term at 6 h: a sum over all lags of a residual that is as smooth as "
            "an open-loop one cannot be as small as what the paper reports, its last term alone can."
            if paper
            else ""
        ),
        quoted=len(quoted),
    )


def cross_correlation(name: str, ranked: Sequence[Fitted]) -> Table:
    """J_xcorr of every candidate and input channel."""
    # A second measured node of the user's own network is no input, though the others do not measure it.
    scored = [entry.scores.j_xcorr for entry in ranked]
    channels = tuple(channel for channel in scored[0] if all(channel in one for one in scored))
    rows: list[tuple[Cell, ...]] = [
        (entry.candidate.name, *(entry.scores.j_xcorr[channel] for channel in channels)) for entry in ranked
    ]
    return Table(
        f"cross-correlation-{name}",
        f"J_xcorr: what of each input is left in the residual, {name}",
        ("network", *channels),
        tuple(rows),
        "Sums of squared correlations over lags up to six hours.",
    )


def parameters(name: str, entry: Fitted, fitted: Arrays) -> Table:
    """What was fitted for the network to take."""
    rows = []
    for parameter, value in zip(entry.candidate.network.parameters, fitted["theta"], strict=True):
        end = "lower end" if value < (parameter.lower * parameter.upper) ** 0.5 else "upper end"
        ended = end if parameter.name in entry.at_bound else "inside" if parameter.free else "held"
        rows.append((parameter.name, parameter.unit, float(value), parameter.lower, parameter.upper, ended))
    return Table(
        f"parameters-{name}",
        f"Parameters of {entry.candidate.name}, {name}",
        ("parameter", "unit", "fitted", "lower bound", "upper bound", "where it ended"),
        tuple(rows),
        "A parameter at an end of its box: the box is too narrow, or the data say nothing about it. A capacitance at "
        "its lower end means a node that is not there, a conductance at its upper end two nodes that are one.",
    )


def _yes(value: bool) -> str:
    return "yes" if value else "no"
