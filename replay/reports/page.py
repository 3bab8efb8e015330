"""The page of a report: what a facility manager and an engineer want to know of each zone after a period."""

from __future__ import annotations

from collections.abc import Sequence

from tqdm import tqdm

from estimator.network.network import Network
from replay.recorded.runner import SLOW
from replay.recorded.trace import Trace
from replay.reports import plots, tables
from replay.reports.advice import advice
from replay.reports.drawing import picture
from replay.reports.kit.report import Picture, Report, Section
from replay.reports.residuals import diagnostics


def report(site: str, traces: Sequence[Trace], progress: bool = False) -> Report:
    """The report of the zones in `traces`, which all have rows. With `progress` a terminal shows how far it is."""
    table = tables.skill(traces)
    drawn = tqdm(traces, unit=" zones", desc="page", delay=SLOW, disable=not progress)
    return Report(
        f"Thermogate report: {site}",
        (*(note for trace in traces for note in trace.notes), *map(_in_a_sentence, traces)),
        (
            Section("All zones", (), (tables.zones(traces), table)),
            *(section for trace in drawn for section in _zone(trace, len(traces) > 1)),
        ),
    )


def _in_a_sentence(trace: Trace) -> str:
    """How a zone did, for a hurried reader."""
    judged = [one for one in tables.horizons(trace) if one.forecasts]
    if not judged:
        return f"`{trace.zone}`: no forecast has come due."
    farthest = judged[-1]
    findings = len(trace.diagnosis.findings)
    return (
        f"`{trace.zone}`: {tables.ahead(trace, farthest)} ahead the error is {farthest.rmse:.2g} K (RMSE), "
        f"{_against(farthest.skill_against_persistence)}, and {100 * farthest.coverage:.0f} % of the 95 % intervals "
        f"held; {findings or 'no'} finding{'' if findings == 1 else 's'}."
    )


def _against(persistence: float) -> str:
    if persistence != persistence:
        return "with nothing to compare it with"
    return f"{abs(100 * persistence):.0f} % {'less' if persistence >= 0 else 'more'} than if nothing changed"


def _zone(trace: Trace, named: bool) -> list[Section]:
    found, head = diagnostics(trace), f"{trace.zone}: " if named else ""
    looked = len(trace.looks) > 0
    seen = [plots.record(trace)]
    said = []
    if trace.fans:
        seen.append(plots.fans(trace))
    else:
        said.append("No whole day between two midnights (UTC) was forecast yet, so there is no fan to verify.")
    if len(trace.gain):
        seen.append(plots.gain(trace))
    else:
        said.append(f"The estimator `{trace.estimator}` has no model of unmeasured heat; `mkf` and `bank` have one.")
    known = tables.parameters(trace) if looked else None
    return [
        Section(_title(head, "what to change"), tuple(advice(trace, found))),
        Section(_title(head, "forecasts"), tuple(said), plots=tuple(seen)),
        Section(
            _title(head, "parameters"),
            () if looked else ("No parameters: the estimator has no physics, or the period is shorter than 6 h.",),
            () if known is None else (known,),
            (plots.parameters(trace),) if looked else (),
            (_picture(trace.network, trace),),
        ),
        Section(
            _title(head, "residuals"),
            () if len(found.pit) else ("No forecast was compared with a measurement.",),
            plots=(plots.pit(found), plots.memory(found), plots.against_inputs(found, trace.period))
            if len(found.pit)
            else (),
        ),
    ]


def _title(head: str, words: str) -> str:
    return f"{head}{words}" if head else words.capitalize()


def _picture(network: Network, trace: Trace) -> Picture:
    last = trace.parameters[-1, :, 1].tolist() if len(trace.looks) else [float("nan")] * len(network.parameters)
    values = {parameter.name: value for parameter, value in zip(network.parameters, last, strict=True)}
    return Picture(
        f"The network {network.name}",
        picture(network, values),
        "Circles store heat, lines conduct it, boxes are temperatures that come from outside, arrows are heat that "
        "enters. The figures are the medians at the end of the period; the dark circle is measured.",
    )
