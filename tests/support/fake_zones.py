"""Zones for the tests of REST, metrics and publisher: real networks, invented but plausible numbers."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from adapters.reading import Quality
from estimator.diagnosis.finding import Diagnosis, Finding, VariantWeight
from estimator.network import presets
from estimator.network.network import Network
from estimator.types import ParameterSummary
from service.errors import NoModel, ServiceError
from service.forecast.ahead import NextRise
from service.forecast.answers import LearnedLaw, ModelPayload, Preheat, Range, Room, RoomAnswer, ToDo
from service.forecast.engine import FanQuestion
from service.forecast.heating import PreheatQuestion
from service.forecast.learned import ModelQuestion, Parameters, ParametersQuestion, SkillQuestion
from service.forecast.plan import Grid, column
from service.forecast.room import RoomQuestion
from service.publish.sinks import Announcement, Occasion
from service.records.fan import CompactOutputPayload, Fan
from service.records.history import HistoryRow
from service.records.outlook import InputOrigin, Surroundings
from service.records.sample import Sample
from service.records.series import COLUMNS, Series
from service.records.skill import HorizonSkill, IssuedSkill, Skill, SkillWindow
from service.records.status import ZoneState, ZoneStatus
from service.records.trust import HorizonTrust, Trust
from service.records.update import Forecast, Gate, InputUsed, Interval, OutputForecast, Score, Update, Volatility
from service.store.series import bucket_of, reduced
from service.store.series import series_of as journal_series

ROOM = Room(
    7.0,
    (
        RoomAnswer("comfort", "Often too cold: 22 h too cold and 3 h too warm of 168 h", "h", 25.0),
        RoomAnswer("heat_loss", "It loses 113 W for each K that it is warmer than outside", "W/K", 113.0),
    ),
    sun=tuple(10.0 * max(0, 6 - abs(hour - 12)) for hour in range(24)),
    people=(80.0,) * 24,
    to_do=(ToDo("shade the windows or air", "it was too warm for 3 h without much heating"),),
)
"""What a room answers."""

START = 1_746_230_400  # 2025-05-03T00:00:00Z
PERIOD = 300


def output(name: str, mean: float, sd: float, levels: Sequence[float]) -> OutputForecast:
    spread = NormalDist(mean, sd)
    intervals = tuple(Interval(p, spread.inv_cdf(0.5 - p / 2), spread.inv_cdf(0.5 + p / 2)) for p in levels)
    return OutputForecast(name, mean, mean, sd, intervals)


def columns(steps: Sequence[OutputForecast], scenarios: int = 0) -> CompactOutputPayload:
    """The forecast of one output as columns, with futures of 20 degC."""
    mean, median, sd = (np.array([getattr(one, name) for one in steps]) for name in ("mean", "median", "sd"))
    lower, upper = (
        np.array([[getattr(interval, side) for interval in one.intervals] for one in steps]).T
        for side in ("lower", "upper")
    )
    futures = np.full((scenarios, len(steps)), 20.0)
    return CompactOutputPayload(steps[0].output, mean, median, sd, lower, upper, futures)


def make_update(step: int, network: Network | None = None, levels: Sequence[float] = (0.95,)) -> Update:
    """Update number `step`: a daily cycle with one disturbed stretch in the evening."""
    network = network or presets.network("ecolar-6r4c")
    time = START + step * PERIOD
    phase = 2 * math.pi * step * PERIOD / 86400
    disturbed = step % 288 in range(200, 225)
    mean = 21.0 - 1.5 * math.cos(phase) + 0.1 / 3
    alpha = 6.0 if disturbed else 1.1 + 0.1 * math.sin(7 * phase)
    sd = 0.05 * math.sqrt(alpha)
    y = mean + 0.04 * math.sin(37.0 * step) + (0.15 if disturbed else 0.0)
    interval = output(network.measured[0], mean, sd, levels).intervals[0]
    return Update(
        time=time,
        segment=0,
        outcome="assimilated",
        y=(y,),
        score=Score((y,), (mean,), (sd,), (interval.lower,), (interval.upper,), (y - mean,), interval.level),
        volatility=Volatility(("process",), (alpha / 1.6,), (alpha,), (alpha * 1.6,), (0.97 if disturbed else 0.4,)),
        gate=Gate(0.05 if disturbed else 0.92, "high" if disturbed else "low"),
        effective_sample_size=6123.456789,
        resampled=step % 9 == 0,
        floored=False,
        log_likelihood=1.25,
        parameters=tuple(p.nominal or 1.0 for p in network.parameters),
        forecast=Forecast(
            sample_time=time,
            issue_time=time + PERIOD,
            valid_time=time + PERIOD,
            outputs=tuple(output(name, mean + 0.02, sd, levels) for name in network.measured),
            inputs=tuple(
                InputUsed(channel, 5.5, network.channel_unit(channel), 0.0, Quality.GOOD, False)
                for channel in network.inputs
            ),
        ),
        step_seconds=0.004,
    )


def skill_over(
    time: int,
    windows: Mapping[int, tuple[HorizonSkill, ...]],
    issued: Mapping[int, tuple[IssuedSkill, ...]] | None = None,
) -> Skill:
    """The skill of no bank, by the days that the windows look back; `issued` is that of forecasts as issued."""
    found = issued or {}
    return Skill(time, 0.95, tuple(SkillWindow(days, one, found.get(days, ())) for days, one in windows.items()), ())


@dataclass
class FakeZone:
    """A zone that stands still; `asked` notes what was asked of it."""

    id: str
    network: Network = field(default_factory=lambda: presets.network("ecolar-6r4c"))
    period: float = PERIOD
    estimator: str = "rbpf"
    updates: list[Update] = field(default_factory=list)
    state: str = "running"
    reason: str = ""
    faults: Mapping[str, int] = field(default_factory=dict)
    failure: Exception | None = None
    diagnosis: Diagnosis = field(default_factory=Diagnosis)
    asked: list[tuple[object, ...]] = field(default_factory=list)
    surroundings: Surroundings = field(default_factory=Surroundings)
    trusted: Trust | None = None
    origins: tuple[InputOrigin, ...] = ()
    heating: Preheat | None = None
    laws: tuple[LearnedLaw, ...] = ()
    answers: Mapping[type, object] = field(default_factory=dict)
    """To other questions, by their type."""

    async def ask(self, question: Any) -> Any:
        """The answer to a question, as if a worker had computed it."""
        if isinstance(question, ModelQuestion):
            return self._model(question)
        if isinstance(question, ParametersQuestion):
            summary = self._parameters(question.levels)
            return None if summary is None else Parameters(summary, self.laws)
        if isinstance(question, SkillQuestion):
            return self.skill()
        if isinstance(question, NextRise):
            return self.heating
        if isinstance(question, RoomQuestion):
            return ROOM if self.updates else None
        if isinstance(question, PreheatQuestion):
            return foreseen(self, **question._asdict(), start=question.by - 5400.0)
        if isinstance(question, FanQuestion):
            return self._fan(question)
        self.asked.append(question)
        return self.answers[type(question)]

    def _fan(self, question: FanQuestion) -> Fan | None:
        """A mean that rises by 0.01 K a step."""
        grid = Grid(0, self.period, question.steps)
        plan = {channel: column(values, grid).tolist() for channel, values in question.planned.items()}
        self.asked.append(("fan", question.steps, question.levels, plan))
        update = self.now().update
        if update is None or self.state == "stalled":
            return None
        ahead, levels, inputs = np.arange(question.steps + 1), question.levels, update.forecast.inputs
        held = (InputOrigin(used.channel, "held", "", used.age, used.quality) for used in inputs)
        origins = tuple(
            InputOrigin(one.channel, "plan", "", math.nan, Quality.GOOD) if one.channel in plan else one
            for one in self.origins or held
        )
        rising = (
            [output(one.output, one.mean + 0.01 * k, one.sd * (1 + k) ** 0.5, levels) for k in ahead]
            for one in update.forecast.outputs
        )
        return Fan(update, levels, tuple(columns(steps, question.scenarios) for steps in rising), origins)

    def _model(self, question: ModelQuestion) -> ModelPayload | None:
        self.asked.append(("model", *question))
        if self.estimator == "arx":
            raise NoModel("it knows no physics")
        return None

    def now(self) -> ZoneState:
        known = self.trusted or Trust(
            START, (HorizonTrust(PERIOD, "trusted", "", START), HorizonTrust(86400, "learning", "wait", START))
        )
        return ZoneState(self._status(), self.updates[-1] if self.updates else None, known if self.updates else Trust())

    def _status(self) -> ZoneStatus:
        last = self.updates[-1].time if self.updates else None
        now = None if last is None else last + PERIOD + 60.0
        seen = dict.fromkeys(self.network.channels, last + 120.0) if last is not None else {}
        return ZoneStatus(
            self.state,
            self.reason,
            last,
            len(self.updates),
            0,
            self.faults,
            seen,
            now,
            self.network.channels,
            diagnosis=self.diagnosis,
        )

    def _parameters(self, levels: Sequence[float]) -> ParameterSummary | None:
        if not self.updates:
            return None
        scale = 1.0 + 0.1 * (np.array(levels) - 0.5)
        nominal = np.array([parameter.nominal or 1.0 for parameter in self.network.parameters])
        constants = np.array([95.0, 864.0, 9612.0, 716400.0])
        collapsed = np.zeros(len(nominal) + len(constants) + 1, dtype=bool)
        return ParameterSummary(
            np.array(levels), nominal[:, None] * scale, constants[:, None] * scale, 105.0 * scale, collapsed=collapsed
        )

    def skill(self) -> Skill | None:
        self.asked.append(("skill",))
        if self.failure is not None:
            raise self.failure
        if not self.updates:
            return None
        one = HorizonSkill.of(300, 12, 0.95, 0.03, 0.05, 0.2, 0.1, 0.06)
        none = HorizonSkill.of(86400, 0, *[math.nan] * 6)
        issued = (IssuedSkill(86400, 12, 0.9, 0.3, 0.5, 1.2, 1.0, 0.8, 0.7, 0.6),)
        days = (1, 7, 30)
        return skill_over(self.updates[-1].time, dict.fromkeys(days, (one, none)), dict.fromkeys(days, issued))

    async def history(self, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        self.asked.append(("history", start, end, limit))
        if self.failure is not None:
            raise self.failure
        rows = [HistoryRow.of(update) for update in self.updates]
        return [r for r in rows if (start is None or r.time >= start) and (end is None or r.time < end)][-limit:]

    async def series(self, start: int, end: int, points: int) -> Series:
        self.asked.append(("series", start, end, points))
        if self.failure is not None:
            raise self.failure
        return series_of(self, start, end, points)


def foreseen(zone: FakeZone, **told: Any) -> Preheat:
    """When to start heating for the next rise of the set-point, but for what is `told`."""
    begin, warm = float(zone.updates[-1].forecast.issue_time), Range(21.0, 20.6, 21.4)
    rise = Preheat(begin, "trusted", 21.0, begin + 9000.0, 0.5, 0.9, begin + 3600.0, 90.0, 0.93, warm, warm, 17.0)
    return replace(rise, **told)


def running(name: str, steps: int = 3, levels: Sequence[float] = (0.95,)) -> FakeZone:
    """A zone with `steps` updates."""
    network = presets.network("ecolar-6r4c")
    return FakeZone(name, network, updates=[make_update(step, network, levels) for step in range(steps)])


def waiting(name: str) -> FakeZone:
    """A zone without its first sample."""
    return FakeZone(name, state="waiting", reason="no reading of T_out yet")


def doubted(name: str) -> FakeZone:
    """A zone whose model does not know everything."""
    zone = running(name)
    zone.diagnosis = Diagnosis(
        (
            Finding("parameter-at-bound", "C_air", "C_air is at its lower bound; move it"),
            Finding("parameter-at-bound", "C_h", "C_h is at its upper bound; move it"),
            Finding("network-variant", "ground", "the variant 'ground' carries 80 % of the forecast; read it so"),
        ),
        (VariantWeight("own", 0.2), VariantWeight("ground", 0.8)),
    )
    return zone


def broken(name: str) -> FakeZone:
    """A zone whose history cannot be read."""
    zone = running(name)
    zone.failure = ServiceError("the journal var/journal.sqlite3 failed (disk I/O error); check the disk it is on")
    return zone


def make_sample(step: int, output: float = 21.3) -> Sample:
    """A sample with every quality, a NaN and a negative zero in it."""
    inputs = np.array([5.0 + 0.1 * step, np.nan, -0.0])
    qualities = (Quality.GOOD, Quality.BAD, Quality.UNCERTAIN)
    return Sample(START + step * PERIOD, np.array([output]), inputs, (Quality.GOOD,), qualities)


def announced(
    zone: str, update: Update | None, status: ZoneStatus, occasion: Occasion = Occasion.UPDATE, site: str = "htwg"
) -> Announcement:
    """What a zone tells its sinks."""
    return Announcement(site, zone, ZoneState(status, update, Trust()), occasion)


def series_of(zone: FakeZone, start: int, end: int, points: int) -> Series:
    """The samples of `zone` in buckets, as the journal would give them."""
    bucket = bucket_of(start, end, int(zone.period), points)
    rows = [HistoryRow.of(update) for update in zone.updates if start <= update.time < end]
    times = np.array([row.time for row in rows], dtype=np.int64)
    table = np.array([[getattr(row, name) for name in COLUMNS] for row in rows]).reshape(len(rows), len(COLUMNS))
    band = np.array([[row.y, row.lower] for row in rows]), np.array([[row.y, row.upper] for row in rows])
    inputs = np.array([[used.value for used in update.forecast.inputs] for update in zone.updates[: len(rows)]])
    width = len(zone.network.inputs)
    low, high = (values.reshape(len(rows), 2) for values in band)
    inputs = inputs.reshape(len(rows), width)
    history = reduced(times, table, low, high, bucket)
    return journal_series(history, reduced(times, inputs, inputs[:, :0], inputs[:, :0], bucket), bucket)
