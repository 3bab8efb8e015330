"""The page of a report: what a facility manager and an engineer want to know of each zone after a period."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from tqdm import tqdm

from replay.recorded.samples import SLOW
from replay.recorded.trace import Trace
from replay.reports import plots, tables
from replay.reports.advice import advice
from replay.reports.kit.report import Report, Section
from replay.reports.residuals import diagnostics
from service.forecast.answers import Room


def report(site: str, traces: Sequence[Trace], progress: bool = False) -> Report:
    """The report of the zones in `traces`, which all have rows. With `progress` a terminal shows how far it is."""
    drawn = tqdm(traces, unit=" zones", desc="page", delay=SLOW, disable=not progress)
    several = len(traces) > 1
    first = (Section("All rooms", (), (tables.to_do(traces),)),) if several else ()
    return Report(
        f"Thermogate report: {site}",
        (*(note for trace in traces for note in trace.notes), *map(_in_a_sentence, traces)),
        (
            *first,
            *(section for trace in drawn for section in _zone(trace, several)),
            Section("All zones", (), (tables.zones(traces), *([tables.skill(traces)] if several else []))),
        ),
    )


def _in_a_sentence(trace: Trace) -> str:
    """How a room did, for a hurried reader."""
    if trace.room is None:
        return f"`{trace.zone}`: no sample could be used."
    first = next(iter(trace.room.to_do), None)
    verdict = trace.room.answers[0].sentence.split("; ")[0]
    return f"`{trace.zone}`: {verdict}. " + ("Nothing is to be done." if first is None else f"To do: {first.what}.")


def _room(title: str, trace: Trace, room: Room) -> Section:
    """The answers, and what to do."""
    to_do = tuple(f"{place}. {one.what}: {one.why}." for place, one in enumerate(room.to_do, start=1))
    heat = (plots.heat(trace, room),) if max(np.nanmax(room.sun), np.nanmax(room.people)) > 0.0 else ()
    said = tuple(f"{one.sentence}." for one in room.answers)
    done = ("What to do:", *to_do) if to_do else ("Nothing is to be done.",)
    return Section(title, (*said, *done), plots=heat)


def _zone(trace: Trace, named: bool) -> list[Section]:
    found, head = diagnostics(trace), f"{trace.zone}: " if named else ""
    looked = len(trace.looks) > 0
    seen = [plots.record(trace)]
    said = []
    if trace.fans:
        seen.append(plots.fans(trace))
    else:
        said.append("No whole day between two midnights was forecast yet, so there is no fan to verify.")
    if len(trace.gain):
        seen.append(plots.gain(trace))
    else:
        said.append(f"The estimator `{trace.estimator}` has no model of unmeasured heat; `mkf` and `bank` have one.")
    known = tables.parameters(trace) if looked else None
    answers = [] if trace.room is None else [_room(_title(head, "how is this room?"), trace, trace.room)]
    return [
        *answers,
        Section(_title(head, "forecasts"), tuple(said), (tables.skill([trace]),), tuple(seen)),
        *([Section(_title(head, "thermostat"), (), (tables.laws(trace),))] if trace.laws else []),
        Section(_title(head, "for experts: what to change in the configuration"), tuple(advice(trace, found))),
        Section(
            _title(head, "for experts: parameters"),
            () if looked else ("No parameters: the estimator has no physics, or the period is shorter than 6 h.",),
            () if known is None else (known,),
            (plots.parameters(trace),) if looked else (),
        ),
        Section(
            _title(head, "for experts: residuals"),
            () if len(found.pit) else ("No forecast was compared with a measurement.",),
            plots=(plots.pit(found), plots.memory(found), plots.against_inputs(found, trace.period))
            if len(found.pit)
            else (),
        ),
    ]


def _title(head: str, words: str) -> str:
    return f"{head}{words}" if head else words.capitalize()
