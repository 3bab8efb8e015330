"""What the topology experiment says: which network to take and why, in words for the engineer of the building."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from replay.experiments.jobs import Arrays
from replay.experiments.topology import tables
from replay.experiments.topology.candidates import OWN
from replay.experiments.topology.data import Recording
from replay.experiments.topology.fit import KNOWN, SHORTEST
from replay.experiments.topology.ranking import COMPARABLE, Fitted
from replay.experiments.topology.toml import AROUND, network_toml, proposal
from replay.localtime import DAY, HOUR
from replay.reports.kit.report import Report, Section
from replay.scores.windows import Window


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


def report(outcomes: Sequence[Outcome]) -> Report:
    """The report of all recordings."""
    files = {f"network-{outcome.recording.name}.toml": _toml(outcome) for outcome in outcomes}
    sections = [_done(outcomes)]
    for outcome, toml in zip(outcomes, files.values(), strict=True):
        sections += [_ranking(outcome), _configure(outcome, toml)]
    return Report(
        "Which RC network to take",
        tuple(sentence for outcome in outcomes for sentence in _lead(outcome)),
        (*sections, _limits(outcomes)),
        files,
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
    name, ours = outcome.recording.name, outcome.recording.place is None
    return Section(
        f"{name}: the candidates",
        (_verdict(outcome),),
        (tables.ranking(name, outcome.ranked, ours), tables.cross_correlation(name, outcome.ranked)),
    )


def _verdict(outcome: Outcome) -> str:
    taken = outcome.taken
    own = [entry for entry in outcome.ranked if entry.candidate.label == OWN and entry is not taken]
    text = f"The network to take is {taken.candidate.name}. {_why(outcome)}"
    for entry in own:
        text += f" Your own ({entry.candidate.name}) loses {100 * entry.loss:.0f} % on average."
    if outcome.recording.synthetic:
        text += (
            " This recording is simulated, with heat that no channel brings. A larger network that fits better has "
            "learned to pass such heat off as its own: this is a trial of the method, no finding about Ecolar Home."
        )
    return text


def _configure(outcome: Outcome, toml: str) -> Section:
    return Section(
        f"{outcome.recording.name}: what to set",
        (
            "Put this into the zone's table, check it with `thermogate check`, and start the zone anew with "
            f"`thermogate run --reset`. Boxes reach from a {AROUND:.0f}th to {AROUND:.0f} times the fitted value, wide "
            "enough for the estimator to correct what the fit took from heat that nobody measured; parameters that "
            "the data could not place keep their whole box.",
            f"```{toml}```",
        ),
        (tables.parameters(outcome.recording.name, outcome.taken, outcome.fits[outcome.taken.candidate.name]),),
    )


def _toml(outcome: Outcome) -> str:
    taken = outcome.taken
    network = proposal(taken.candidate.network, outcome.fits[taken.candidate.name]["theta"], taken.at_bound)
    reason = f"{taken.candidate.name}, found by `thermogate experiment topology` on {outcome.recording.name}"
    return network_toml(network, reason, outcome.recording.place)


def _limits(outcomes: Sequence[Outcome]) -> Section:
    paragraphs = [
        "Least squares knows no disturbances: whatever heats the room unmeasured is explained by the parameters as far "
        "as they can. So the fit chooses the structure and the middle of the boxes; the parameters themselves are for "
        "the online estimator to learn.",
        "The open-loop error has several minima: a large network that fits worse than a small one that it contains is "
        "a minimum missed, not a finding.",
    ]
    if any(outcome.recording.place is None for outcome in outcomes):
        paragraphs.append(
            "Where the paper is silent, a window restarts with the hidden temperatures that follow the measurements, "
            "they are fitted after a gap, and J_acf and J_xcorr are summed from lags 1 and 0."
        )
    return Section("How far to trust this", tuple(paragraphs))
