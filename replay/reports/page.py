"""The page of a report: what a facility manager and an engineer want to know of each zone after a period."""

from collections.abc import Iterator, Sequence

import numpy as np
from tqdm import tqdm

from adapters.fields.durations import spoken_duration
from replay.localtime import HOUR
from replay.recorded.trace import Trace
from replay.reports import plots, tables
from replay.reports.advice import advice
from replay.reports.kit.document import PARTED, Document
from replay.reports.kit.report import Plot, Report, Section
from replay.reports.kit.table import Table
from replay.reports.residuals import diagnostics
from service.forecast.answers import Room
from service.forecast.heating import COLD
from service.recordings.progress import SLOW
from service.records.trust import DOUBTFUL, TRUSTED, UNTRUSTED, Trust


def report(site: str, traces: Sequence[Trace], progress: bool = False) -> Report:
    """The report of the zones in `traces`, which all have rows. With `progress` a terminal shows how far it is."""
    ranked = tables.worst_first(traces)
    drawn = tqdm(ranked, unit=" zones", desc="page", delay=SLOW, disable=not progress)
    document, several = Document(__package__), len(traces) > 1
    clocks = " and ".join(dict.fromkeys(trace.clock for trace in traces))
    return Report(
        document.title.format(site=site),
        tuple(map(_in_a_sentence, ranked)),
        (
            *([document.section("All rooms", tables.to_do(ranked))] if several else []),
            *(section for trace in drawn for section in _zone(document, trace, several)),
            document.section(
                "All zones",
                tables.zones(traces),
                tables.skill(traces) if several else None,
                clocks=clocks,
                notes=PARTED.join(note for trace in traces for note in trace.notes),
            ),
        ),
    )


def _in_a_sentence(trace: Trace) -> str:
    if trace.room is None:
        return f"`{trace.zone}`: no sample could be used."
    first = next(iter(trace.room.to_do), None)
    verdict = trace.room.answers[0].sentence.split("; ")[0]
    return f"`{trace.zone}`: {verdict}. " + ("Nothing is to be done." if first is None else f"To do: {first.what}.")


def _answers(room: Room) -> tuple[str, ...]:
    to_do = tuple(f"{place}. {one.what}: {one.why}." for place, one in enumerate(room.to_do, start=1))
    return (f"{room.answers[0].sentence}.", *(("What to do:", *to_do) if to_do else ("Nothing is to be done.",)))


def _trusted(trust: Trust) -> str:
    """How far ahead the forecasts can be relied on, where they cannot, and why."""
    good, doubted = (
        ", ".join(spoken_duration(one.lead) for one in trust.horizons if one.level in levels)
        for levels in ((TRUSTED,), (DOUBTFUL, UNTRUSTED))
    )
    told = f"nothing speaks against the forecasts {good} ahead" if good and not trust.beaten else ""
    care = "" if told and not doubted else "take the forecasts with care" + (f" {doubted} ahead" if doubted else "")
    reasons = dict.fromkeys(one.reason for one in trust.horizons if one.reason and one.reason not in trust.beaten)
    sentence = "; ".join(filter(None, (care, told, *reasons, trust.beaten)))
    return sentence[0].upper() + sentence[1:]


def _start(document: Document, trace: Trace) -> str:
    found = trace.heating
    if found is None:
        return ""
    begin = found.start or float(trace.rows[-1].time + trace.period)
    hours = (found.by - begin) / HOUR
    (told,) = document.lines(
        "When to start heating" if found.start else "Too late to heat",
        begin=trace.moment(int(begin)),
        before=f"{hours:.2g} h" if hours >= 1.0 else f"{60.0 * hours:.2g} min",
        by=trace.moment(int(found.by)),
        target=found.target,
        tolerance=COLD,
        share=100.0 * found.reached,
    )
    return told


def _zone(document: Document, trace: Trace, named: bool) -> Iterator[Section]:
    found, looked, room = diagnostics(trace), len(trace.looks) > 0, trace.room
    seen = len(found.pit) > 0

    def section(heading: str, *shown: Table | Plot | None, **values: object) -> Section:
        made = document.section(heading, *shown, **values)
        return made._replace(title=f"{trace.zone}: {heading[0].lower()}{heading[1:]}") if named else made

    def said(heading: str, **values: object) -> str:
        return document.lines(heading, **values)[0]

    if room is not None:
        warmed = max(np.nanmax(room.sun), np.nanmax(room.people)) > 0.0
        answers = PARTED.join(_answers(room))
        drawn = plots.heat(trace, room) if warmed else None
        yield section(
            "How is this room?", tables.answers(room), drawn, answers=answers, heating=_start(document, trace)
        )
    yield section(
        "Forecasts",
        tables.skill([trace]),
        plots.record(trace),
        plots.fans(trace) if trace.fans else None,
        plots.gain(trace) if len(trace.gain) else None,
        trusted=f"{_trusted(trace.trust)}." if trace.trust.horizons else "",
        no_fans="" if trace.fans else said("No fans"),
        no_gain="" if len(trace.gain) else said("No gain", estimator=trace.estimator),
        thinned=f" {said('Thinned', every=every)}" if (every := plots.thinned(len(trace.rows))) > 1 else "",
    )
    if trace.laws:
        yield section("Thermostat", tables.laws(trace))
    advised = section("For experts: what to change in the configuration")
    yield advised._replace(paragraphs=tuple(advice(trace, found)))
    yield section(
        "For experts: parameters",
        *((tables.parameters(trace), plots.parameters(trace)) if looked else ()),
        none="" if looked else said("No parameters"),
        moment=trace.moment(int(trace.looks[-1])) if looked else "",
    )
    yield section(
        "For experts: residuals",
        *((plots.pit(found), plots.memory(found), plots.against_inputs(found, trace.period)) if seen else ()),
        none="" if seen else said("No residuals"),
    )
