"""What the topology experiment says: which network to take and why, in words for the engineer of the building."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from replay.experiments.topology.candidates import OWN
from replay.experiments.topology.data import Recording
from replay.experiments.topology.fit import DAYS, HELD_OUT, KNOWN, NIGHTLY, NIGHTS, SCORES, SHORTEST, TRAIN
from replay.experiments.topology.ranking import COMPARABLE, Fitted
from replay.experiments.topology.toml import AROUND, network_toml, proposal
from replay.localtime import DAY, HOUR
from replay.reports.kit.document import Document
from replay.reports.kit.report import Report
from replay.reports.kit.table import Cell, Table


def _found(figure: str, entry: Fitted) -> Cell:
    return entry.found[figure]


COLUMNS: Mapping[str, Callable[[Fitted], Cell]] = {
    "network": lambda entry: entry.candidate.label,
    "sun": lambda entry: "yes" if entry.candidate.solar else "no",
    "states": lambda entry: len(entry.candidate.network.nodes),
    "free parameters": lambda entry: len(entry.candidate.network.free),
    **{name: partial(_found, name) for name in (*SCORES, "J_acf", "its term at 6 h")},
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


def report(found: Sequence[tuple[Recording, Sequence[Fitted]]]) -> Report:
    document, lead, done, sections, files = Document(__package__), list[str](), list[str](), [], {}
    for recording, ranked in found:
        name, record, taken = recording.name, recording.record, ranked[0]
        span = float(record.times[-1] - record.times[0] + record.period)
        said = {"name": name, "network": taken.candidate.name, "why": why(ranked)}
        lines = document.lines("Lead", **said, described=taken, at_bound=", ".join(taken.at_bound) or "nothing")
        lead += lines if taken.at_bound else lines[:1]
        done += document.lines(
            "Recording",
            name=name,
            what=recording.what,
            zone=recording.time_zone,
            days=span / DAY,
            minutes=record.period // 60,
            used=100 * sum(end - begin for begin, end in recording.windows) * record.period / span,
            pieces=len(recording.windows),
            shortest=SHORTEST // HOUR,
            nights=taken.found[NIGHTS],
            mornings=taken.found[DAYS],
        )
        own = [
            f"Your own ({entry.candidate.name}) loses {100 * entry.loss:.0f} % on average."
            for entry in ranked[1:]
            if entry.candidate.label == OWN
        ]
        standin = recording.place is None
        rows = tuple(tuple(cell(entry) for cell in COLUMNS.values()) for entry in ranked)
        quoted = TABLE_3 if standin else ()
        sections.append(
            document.section(
                "{name}: the candidates",
                Table(f"ranking-{name}", tuple(COLUMNS), rows + quoted, quoted=len(quoted)),
                **said,
                own=" ".join(own),
                standin=document.lines("Stand-in")[0] if standin else "",
            )
        )
        reason = f"{taken.candidate.name}, found by `thermogate experiment topology` on {name}"
        network = proposal(taken.candidate.network, taken.theta, taken.at_bound)
        files[f"network-{name}.toml"] = toml = network_toml(network, reason, recording.place)
        configured = {"around": AROUND, "toml": f"```{toml}```"}
        sections.append(
            document.section("{name}: what to set", _parameters(f"parameters-{name}", taken), **said, **configured)
        )
    method = document.section("What was done", known=100 * KNOWN, comparable=100 * COMPARABLE)
    method = method._replace(paragraphs=(*done, *method.paragraphs))
    limits = document.section("How far to trust this")
    return Report(document.title, tuple(lead), (method, *sections, limits), files)


def why(ranked: Sequence[Fitted]) -> str:
    taken, best = ranked[0], min(ranked, key=lambda entry: entry.loss)
    train, held_out, nights = (taken.found[name] for name in (TRAIN, HELD_OUT, NIGHTLY))
    scores = f"Without measurements it stays within {train:.2f} K (RMSE) of the recording it was fitted to"
    if np.isfinite(held_out):
        scores += f" and within {held_out:.2f} K of the part it had not seen"
    scores += f"; nights it misses by {nights:.2f} K on average." if np.isfinite(nights) else "."
    if best is taken:
        return f"{scores} No candidate is better in this on average."
    return (
        f"{scores} {best.candidate.name}, {best}, is better on average by no more than "
        f"{100 * COMPARABLE:.0f} %, which does not pay for what it adds."
    )


def _parameters(name: str, taken: Fitted) -> Table:
    rows = []
    for parameter, value in zip(taken.candidate.network.parameters, taken.theta.tolist(), strict=True):
        end = "lower end" if value < (parameter.lower * parameter.upper) ** 0.5 else "upper end"
        ended = end if parameter.name in taken.at_bound else "inside" if parameter.free else "held"
        rows.append((parameter.name, parameter.unit, value, parameter.lower, parameter.upper, ended))
    return Table(name, ("parameter", "unit", "fitted", "lower bound", "upper bound", "where it ended"), tuple(rows))
