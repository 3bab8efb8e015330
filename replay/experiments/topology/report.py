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
from replay.reports.kit.document import Document
from replay.reports.kit.report import Report
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
    document, lead, done, sections, files = Document(__package__), list[str](), list[str](), [], {}
    for outcome in outcomes:
        name, what, record, _, zone, _ = outcome.recording
        taken, scores = outcome.taken, outcome.taken.scores
        span = float(record.times[-1] - record.times[0] + record.period)
        said = {"name": name, "network": taken.candidate.name, "why": _why(outcome)}
        lines = document.lines(
            "Lead", **said, described=_described(taken), at_bound=", ".join(taken.at_bound) or "nothing"
        )
        lead += lines if taken.at_bound else lines[:1]
        done += document.lines(
            "Recording",
            name=name,
            what=what,
            zone=zone,
            days=span / DAY,
            minutes=record.period // 60,
            used=100 * sum(end - begin for begin, end in outcome.windows) * record.period / span,
            pieces=len(outcome.windows),
            shortest=SHORTEST // HOUR,
            nights=scores.nights,
            mornings=scores.days,
        )
        files[f"network-{name}.toml"] = toml = outcome.toml
        standin = outcome.recording.place is None
        own = [
            f"Your own ({entry.candidate.name}) loses {100 * entry.loss:.0f} % on average."
            for entry in outcome.ranked
            if entry.candidate.label == OWN and entry is not taken
        ]
        rows = tuple(tuple(cell(entry) for cell in COLUMNS.values()) for entry in outcome.ranked)
        quoted = TABLE_3 if standin else ()
        sections.append(
            document.section(
                "{name}: the candidates",
                Table(f"ranking-{name}", tuple(COLUMNS), rows + quoted, quoted=len(quoted)),
                cross_correlation(name, outcome.ranked),
                **said,
                own=" ".join(own),
                standin=document.lines("Stand-in")[0] if standin else "",
            )
        )
        configured = {"around": AROUND, "toml": f"```{toml}```"}
        sections.append(document.section("{name}: what to set", _parameters(outcome), **said, **configured))
    method = document.section("What was done", known=100 * KNOWN, comparable=100 * COMPARABLE)
    method = method._replace(paragraphs=(*done, *method.paragraphs))
    limits = document.section("How far to trust this")
    return Report(document.title, tuple(lead), (method, *sections, limits), files)


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


def cross_correlation(name: str, ranked: Sequence[Fitted]) -> Table:
    """J_xcorr of every candidate and input channel."""
    # A second measured node of the user's own network is no input, though the others do not measure it.
    scored = [entry.scores.j_xcorr for entry in ranked]
    channels = tuple(channel for channel in scored[0] if all(channel in one for one in scored))
    return Table(
        f"cross-correlation-{name}",
        ("network", *channels),
        tuple((entry.candidate.name, *(entry.scores.j_xcorr[channel] for channel in channels)) for entry in ranked),
    )


def _parameters(outcome: Outcome) -> Table:
    """What was fitted for the network to take."""
    taken, rows = outcome.taken, []
    fitted = outcome.fits[taken.candidate.name]["theta"].tolist()
    for parameter, value in zip(taken.candidate.network.parameters, fitted, strict=True):
        end = "lower end" if value < (parameter.lower * parameter.upper) ** 0.5 else "upper end"
        ended = end if parameter.name in taken.at_bound else "inside" if parameter.free else "held"
        rows.append((parameter.name, parameter.unit, value, parameter.lower, parameter.upper, ended))
    head = ("parameter", "unit", "fitted", "lower bound", "upper bound", "where it ended")
    return Table(f"parameters-{outcome.recording.name}", head, tuple(rows))
