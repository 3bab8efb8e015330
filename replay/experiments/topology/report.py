"""What the topology experiment says: which network to take and why, in words for the engineer of the building."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from replay.experiments.jobs import Arrays
from replay.experiments.topology.candidates import OWN
from replay.experiments.topology.data import Recording
from replay.experiments.topology.fit import KNOWN, SHORTEST
from replay.experiments.topology.ranking import COMPARABLE, Fitted
from replay.experiments.topology.toml import AROUND, network_toml, proposal
from replay.localtime import DAY, HOUR
from replay.reports.kit.report import Report, Section
from replay.reports.kit.table import Cell, Table
from replay.scores.windows import Window

COLUMNS: Mapping[str, Callable[[Fitted], Cell]] = {
    "network": lambda entry: entry.candidate.label,
    "sun": lambda entry: "yes" if entry.candidate.solar else "no",
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
TABLE_3: tuple[tuple[Cell, ...], ...] = (
    ("M1, paper", "no", 2, None, 0.637, 0.508, 0.314, 0.934, None, None, 0.136, None, None),
    ("M2, paper", "no", 3, None, 0.369, 0.284, 0.284, 0.560, None, None, 0.047, None, None),
    ("M4, paper", "no", 4, None, 0.359, 0.274, 0.256, 0.549, None, None, 0.021, None, None),
    ("M4, paper", "yes", 4, None, 0.363, 0.277, 0.258, 0.543, None, None, 0.051, None, None),
    ("M8, paper", "no", 5, None, 0.365, 0.277, 0.270, 0.533, None, None, 0.016, None, None),
)
"""What the paper found for Ecolar Home, May-June 2025. Its J_acf stands under the term at 6 h: a sum over all lags of a
residual that is as smooth as an open-loop one cannot be as small, its last term alone can."""


class Outcome(NamedTuple):
    """A recording, its unbroken pieces, its candidates by rank, and their fits by name."""

    recording: Recording
    windows: Sequence[Window]
    ranked: Sequence[Fitted]
    fits: Mapping[str, Arrays]

    @property
    def taken(self) -> Fitted:
        """The one to take."""
        return self.ranked[0]

    @property
    def toml(self) -> str:
        """The table of the network to take."""
        taken, name = self.taken, self.recording.name
        network = proposal(taken.candidate.network, self.fits[taken.candidate.name]["theta"], taken.at_bound)
        reason = f"{taken.candidate.name}, found by `thermogate experiment topology` on {name}"
        return network_toml(network, reason, self.recording.place)


def report(outcomes: Sequence[Outcome]) -> Report:
    """The report of all recordings."""
    tomls = [outcome.toml for outcome in outcomes]
    sections = [_done(outcomes)]
    for outcome, toml in zip(outcomes, tomls, strict=True):
        sections += [_ranking(outcome), _configure(outcome, toml)]
    return Report(
        "Which RC network to take",
        tuple(sentence for outcome in outcomes for sentence in _lead(outcome)),
        (*sections, _LIMITS),
        {f"network-{outcome.recording.name}.toml": toml for outcome, toml in zip(outcomes, tomls, strict=True)},
    )


def _lead(outcome: Outcome) -> list[str]:
    taken, name = outcome.taken, outcome.recording.name
    found = [f"{name}: take {taken.candidate.name}, {_described(taken)}. {_why(outcome)}"]
    if taken.at_bound:
        found.append(
            f"{name}: the recording does not determine {', '.join(taken.at_bound)} of it: they ended at an end of "
            "their box. A recording with more heating and weather in it would help, or wider bounds where the building "
            "warrants them."
        )
    return found


def _described(entry: Fitted) -> str:
    network = entry.candidate.network
    return f"{len(network.nodes)} states and {len(network.free)} free parameters"


def _why(outcome: Outcome) -> str:
    taken = outcome.taken
    best = min(outcome.ranked, key=lambda entry: entry.loss)
    held_out, nights = taken.scores.held_out_rmse, taken.scores.night_mae
    scores = (
        f"Without measurements it stays within {taken.scores.train_rmse:.2f} K (RMSE) of the recording it was fitted to"
    )
    if np.isfinite(held_out):
        scores += f" and within {held_out:.2f} K of the part it had not seen"
    scores += f"; nights it misses by {nights:.2f} K on average." if np.isfinite(nights) else "."
    if best is taken:
        return f"{scores} No candidate is better in this on average."
    return (
        f"{scores} {best.candidate.name}, {_described(best)}, is better on average by no more than "
        f"{100 * COMPARABLE:.0f} %, which does not pay for what it adds."
    )


def _done(outcomes: Sequence[Outcome]) -> Section:
    lines = []
    for outcome in outcomes:
        name, what, record, _, zone, *_ = outcome.recording
        span, scores = float(record.times[-1] - record.times[0] + record.period), outcome.taken.scores
        used = sum(end - begin for begin, end in outcome.windows) * record.period / span
        lines.append(
            f"`{name}`: {what}. {span / DAY:.1f} days, a sample every {record.period // 60} min; {100 * used:.0f} % of "
            f"them in {len(outcome.windows)} unbroken pieces of at least {SHORTEST // HOUR} h. Local time is {zone}: "
            f"{scores.nights} complete nights (20:00 to 06:00), {scores.days} complete days (07:00 to 17:00)."
        )
    return Section(
        "What was done",
        (
            *lines,
            "Every candidate was fitted by least squares on the open-loop error, from several starts, the best of "
            "which counts; where a piece begins, the temperatures that nobody measures are fitted too. Each fit was "
            "then restarted at every night and every day, and repeated on the first "
            f"{100 * KNOWN:.0f} % of the data, to run through the rest (held-out RMSE).",
            "Taken is the network with the fewest free parameters, of equals that with the fewest at a bound, among "
            f"those whose loss is at most {100 * COMPARABLE:.0f} percent points above the smallest: the paper's rule, "
            "that errors which are comparable do not justify another hidden state, as a number.",
        ),
    )


def _ranking(outcome: Outcome) -> Section:
    taken, name, standin = outcome.taken, outcome.recording.name, outcome.recording.place is None
    text = f"The network to take is {taken.candidate.name}. {_why(outcome)}"
    for entry in outcome.ranked:
        if entry.candidate.label == OWN and entry is not taken:
            text += f" Your own ({entry.candidate.name}) loses {100 * entry.loss:.0f} % on average."
    if standin:
        text += (
            " This recording is simulated, with heat that no channel brings. A larger network that fits better has "
            "learned to pass such heat off as its own: this is a trial of the method, no finding about Ecolar Home."
        )
    rows = tuple(tuple(cell(entry) for cell in COLUMNS.values()) for entry in outcome.ranked)
    quoted = TABLE_3 if standin else ()
    ranking = Table(
        f"ranking-{name}",
        f"Candidates, {name}",
        tuple(COLUMNS),
        rows + quoted,
        "The first row is the network to take, the others follow by loss: how far train RMSE, night MAE and "
        "held-out RMSE lie above the best candidate in each, on geometric average.",
        quoted=len(quoted),
    )
    return Section(f"{name}: the candidates", (text,), (ranking, cross_correlation(name, outcome.ranked)))


def cross_correlation(name: str, ranked: Sequence[Fitted]) -> Table:
    """J_xcorr of every candidate and input channel."""
    # A second measured node of the user's own network is no input, though the others do not measure it.
    scored = [entry.scores.j_xcorr for entry in ranked]
    channels = tuple(channel for channel in scored[0] if all(channel in one for one in scored))
    return Table(
        f"cross-correlation-{name}",
        f"J_xcorr: what of each input is left in the residual, {name}",
        ("network", *channels),
        tuple((entry.candidate.name, *(entry.scores.j_xcorr[channel] for channel in channels)) for entry in ranked),
        "Sums of squared correlations over lags up to six hours.",
    )


def _configure(outcome: Outcome, toml: str) -> Section:
    name, taken, rows = outcome.recording.name, outcome.taken, []
    fitted = outcome.fits[taken.candidate.name]["theta"].tolist()
    for parameter, value in zip(taken.candidate.network.parameters, fitted, strict=True):
        end = "lower end" if value < (parameter.lower * parameter.upper) ** 0.5 else "upper end"
        ended = end if parameter.name in taken.at_bound else "inside" if parameter.free else "held"
        rows.append((parameter.name, parameter.unit, value, parameter.lower, parameter.upper, ended))
    table = Table(
        f"parameters-{name}",
        f"Parameters of {taken.candidate.name}, {name}",
        ("parameter", "unit", "fitted", "lower bound", "upper bound", "where it ended"),
        tuple(rows),
        "A parameter at an end of its box: the box is too narrow, or the data say nothing about it. A capacitance at "
        "its lower end means a node that is not there, a conductance at its upper end two nodes that are one.",
    )
    return Section(
        f"{name}: what to set",
        (
            "Put this into the zone's table, check it with `thermogate check`, and start the zone anew with "
            f"`thermogate run --reset`. Boxes reach from a {AROUND:.0f}th to {AROUND:.0f} times the fitted value, wide "
            "enough for the estimator to correct what the fit took from heat that nobody measured; parameters that "
            "the data could not place keep their whole box.",
            f"```{toml}```",
        ),
        (table,),
    )


_LIMITS = Section(
    "How far to trust this",
    (
        "Least squares knows no disturbances: whatever heats the room unmeasured is explained by the parameters as far "
        "as they can. So the fit chooses the structure and the middle of the boxes; the parameters themselves are for "
        "the online estimator to learn.",
        "The open-loop error has several minima: a large network that fits worse than a small one that it contains is "
        "a minimum missed, not a finding.",
    ),
)
