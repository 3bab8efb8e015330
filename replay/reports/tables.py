"""The tables of a report; the same rows stand in the terminal and on the page."""

import math
from collections.abc import Sequence

import numpy as np

from estimator.diagnosis.finding import amount
from replay.localtime import HOUR
from replay.recorded.trace import LEVELS, Trace
from replay.reports.kit.table import Cell, Table, shown
from service.cli.tables import aligned
from service.forecast.answers import Range, Room
from service.records.skill import HorizonSkill

_ABOUT = {
    "heat_loss": "heat loss",
    "cooling": "cooling down",
    "heating": "full heating",
    "warming_up": "warming up",
    "other_heat": "other heat",
    "energy": "energy",
    "saving": "1 K less",
    "window": "open window",
    "last_day": "forecasts of the last day",
}
SKILL = "What the forecasts were worth"
_HEADER = ("zone", "ahead", "forecasts", "coverage", "width [K]", "RMSE [K]", "against persistence", "against ARX")


def horizons(trace: Trace) -> Sequence[HorizonSkill]:
    """What the forecasts of the longest window were worth, from the shortest horizon."""
    return () if trace.skill is None else trace.skill.longest


def skill(traces: Sequence[Trace]) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (
            trace.zone,
            ahead(trace, one),
            one.forecasts,
            one.coverage,
            one.width,
            one.rmse,
            percent(one.skill_against_persistence),
            percent(one.skill_against_arx),
        )
        for trace in traces
        for one in horizons(trace)
    ]
    return Table("skill", _HEADER, tuple(rows), SKILL)


def ahead(trace: Trace, one: HorizonSkill) -> str:
    return "one step" if one.lead == trace.period else f"{one.lead / HOUR:g} h"


def percent(share: float) -> str:
    return "–" if np.isnan(share) else f"{round(100.0 * share):+d} %"


def terminal(table: Table) -> list[str]:
    return [table.title, *aligned([table.columns, *(tuple(map(shown, row)) for row in table.rows)])]


def zones(traces: Sequence[Trace]) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (
            trace.zone,
            trace.network.name,
            trace.estimator,
            trace.moment(trace.rows[0].time),
            trace.moment(trace.rows[-1].time),
            len(trace.rows),
            sum(trace.faults.values()),
            len(trace.diagnosis.findings),
        )
        for trace in traces
    ]
    columns = ("zone", "network", "estimator", "from", "to", "samples", "refused readings", "findings")
    return Table("zones", columns, tuple(rows))


def worst_first(traces: Sequence[Trace]) -> list[Trace]:
    """First the zone with what is most urgent, then the one that is uncomfortable longest; last what needs nothing."""

    def urgency(trace: Trace) -> tuple[float, float]:
        if trace.room is None or not trace.room.to_do:
            return math.inf, 0.0
        return trace.room.to_do[0].urgency, -trace.room.answers[0].value / trace.room.days

    return sorted(traces, key=urgency)


def to_do(traces: Sequence[Trace]) -> Table:
    rooms = ((trace.zone, trace.room) for trace in traces if trace.room is not None)
    rows = tuple((zone, one.what, one.why) for zone, room in rooms for one in room.to_do)
    return Table("to-do", ("zone", "what", "why"), rows)


def answers(room: Room) -> Table:
    rows = tuple((_ABOUT[one.about], f"{one.sentence}.") for one in room.answers[1:])
    return Table("answers", ("about", "answer"), rows)


def laws(trace: Trace) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (law.channel, law.side, law.law, *(_between(part) for part in (law.power, law.offset, law.band)), law.days)
        for law in trace.laws
    ]
    columns = ("channel", "side", "law", "power [W]", "offset [K]", "band [K]", "days")
    return Table("thermostat", columns, tuple(rows))


def _between(part: Range) -> str:
    return f"{amount(part.mean)} ({amount(part.lower)} to {amount(part.upper)})"


def parameters(trace: Trace) -> Table:
    low, median, high = (f"{100 * level:g} % quantile" for level in LEVELS)
    rows: list[tuple[Cell, ...]] = []
    for parameter, quantiles in zip(trace.network.parameters, trace.parameters[-1].tolist(), strict=True):
        bounds = map(amount, (parameter.lower, parameter.upper)) if parameter.free else (None, None)
        kind = "fixed" if not parameter.free else "collapsed" if np.isnan(quantiles[0]) else "learned"
        rows.append((parameter.name, parameter.unit, *_known(quantiles), *bounds, kind))
    rows.append(("heat loss to all sides", "W/K", *_known(trace.heat_loss[-1].tolist()), None, None, "derived"))
    columns = ("parameter", "unit", low, median, high, "lower bound", "upper bound", "kind")
    return Table("parameters", columns, tuple(rows))


def _known(quantiles: Sequence[float]) -> list[Cell]:
    """`quantiles` as cells, of which those of an interval that has collapsed are empty."""
    return [None if np.isnan(value) else amount(value) for value in quantiles]
