"""What a zone's worker went through over a period, for the report of it."""

from array import array
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from adapters.fields.times import utc
from estimator import registry
from estimator.arrays import Array
from estimator.diagnosis.finding import Diagnosis
from estimator.network.network import Network
from estimator.verification.hindsight import SAMPLES
from replay.localtime import DAY, HOUR, Seconds, wall_clock
from service.config.fitting import power_entered
from service.config.site import ZoneConfig
from service.forecast.ahead import NextRise, next_heating
from service.forecast.answers import LearnedLaw, Room
from service.forecast.foresight import NO_WEATHER
from service.forecast.learned import learned_laws
from service.forecast.room import Past, RoomQuestion
from service.publish.payloads import NextHeatingPayload
from service.records.history import HISTORY_COLUMNS, HistoryRow
from service.records.record import values
from service.records.series import GAIN
from service.records.skill import Skill
from service.records.trust import Trust
from service.records.update import Update
from service.zone.worker import ZoneWorker

LEVELS = (0.025, 0.5, 0.975)
"""Quantiles of parameters, heat loss and fans."""

EVERY = 6 * HOUR
"""s between two looks at the posterior: quantiles of thousands of particles cost tens of ms. Before the last weeks of a
long history there is one a day, and no forecast of a day, of which the report shows those of the last month."""


_ROOM_DAYS = 28
"""Days of the period that say how the room does."""


class Fan(NamedTuple):
    """A forecast over a local day under the inputs that really followed, in hindsight."""

    times: Seconds
    """(h,): UTC s of the samples that it is about."""
    quantiles: Array
    """(h, 3): of the first output [degC] at LEVELS."""


class Trace(NamedTuple):
    """A zone over a period of K updates, oldest first; times and `period` in s, `level` of the intervals in `rows`,
    `options` of the estimator, `faults` refused readings by kind, `notes` on where figures come from, `laws` of the
    thermostat, `room` and `trust` at the end, `time_zone` an IANA name or None for UTC."""

    zone: str
    network: Network
    estimator: str
    period: int
    level: float
    options: Mapping[str, Any]
    rows: list[HistoryRow]
    inputs: Array
    """(K, n_u): in force from each sample to the next, in the network's units."""
    looks: Seconds
    """(M,): when the posterior was looked at."""
    parameters: Array
    """(M, n_theta, 3): quantiles at LEVELS, each in its unit; M is 0 for an estimator without physics."""
    heat_loss: Array
    """(M, 3): quantiles at LEVELS [W/K]."""
    fans: list[Fan]
    faults: Mapping[str, int]
    skill: Skill | None = None
    diagnosis: Diagnosis = Diagnosis()
    notes: tuple[str, ...] = ()
    laws: tuple[LearnedLaw, ...] = ()
    room: Room | None = None
    heating: NextHeatingPayload | None = None
    """When to start heating after the period; None as it is for a daemon."""
    trust: Trust = Trust()
    time_zone: str | None = None

    def local(self, times: Seconds) -> Seconds:
        """UTC s `times` as seconds of the site's wall clock."""
        return times if self.time_zone is None else wall_clock(times, self.time_zone)

    def moment(self, time: int) -> str:
        """UTC s `time` as the clocks of the site show it."""
        local = int(self.local(np.array([time], dtype=np.int64))[0])
        return f"{utc(local):%Y-%m-%d %H:%M}"

    @property
    def clock(self) -> str:
        """What the times of `local` are called."""
        return self.time_zone or "UTC"

    @property
    def gain(self) -> Array:
        """(K, 3): unmeasured heat [W] at LEVELS; (0, 3) where the estimator has no model of it."""
        gain = np.array([[row.gain_lower, row.gain_median, row.gain_upper] for row in self.rows]).reshape(-1, 3)
        return gain if np.isfinite(gain).any() else gain[:0]


def known_by(worker: ZoneWorker, zone: ZoneConfig, trace: Trace) -> Trace:
    """`trace` with all that the `worker` of its `zone` has come to know."""
    rise = NextRise.within_a_day(worker.period)
    return trace._replace(
        skill=worker.skill(),
        diagnosis=worker.diagnosis(),
        trust=worker.trust,
        laws=learned_laws(worker),
        room=_room_of(worker, zone, trace),
        heating=next_heating(rise(worker, NO_WEATHER, lambda: False), worker.trust),
    )


def _room_of(worker: ZoneWorker, zone: ZoneConfig, trace: Trace) -> Room | None:
    """How the room did over the last days; None without a sample."""
    rows, inputs = trace.rows[-_ROOM_DAYS * DAY // worker.period :], trace.inputs
    if not rows:
        return None
    names = ("time", "y", "setpoint", *GAIN)
    told = np.array([[getattr(row, name) for name in names] for row in rows], dtype=np.float64)
    times, y, setpoint, *gain = told.T
    past = Past(times, float(worker.period), y, setpoint, np.column_stack(gain), inputs[-len(rows) :])
    area = np.nan if zone.floor_area is None else zone.floor_area
    question = RoomQuestion(past, area, zone.whereabouts.time_zone, power_entered(zone))
    return question(worker, NO_WEATHER, lambda: False)


class _Issue(NamedTuple):
    first: int
    """UTC s of the first sample that it is about."""
    segment: int
    sample: Any


class Tracer:
    """Watches one worker, update by update. A year of samples takes some ten bytes for each number of each."""

    def __init__(self, zone: ZoneConfig, worker: ZoneWorker) -> None:
        self._zone, self._worker = zone, worker
        self.rows: list[HistoryRow] = []
        self._inputs = array("d")
        self._looks: list[int] = []
        self._parameters: list[Array] = []
        self._heat_loss: list[Array] = []
        self._issue: _Issue | None = None
        self._followed: dict[int, Array] = {}
        """Inputs in force from each sample since the pending issue, by its time."""
        self._fans: list[Fan] = []

    def note(self, update: Update) -> None:
        held = self._worker.carried.held.values
        self.rows.append(HistoryRow.of(update))
        self._inputs.extend(held.tolist())
        self._look(update)
        self._verify(update, held)

    def remember(self, row: HistoryRow, inputs: Array) -> None:
        """Take down what a daemon has kept of a sample before, and the `inputs` (n_u,) that were in force."""
        self.rows.append(row)
        self._inputs.extend(inputs.tolist())

    def trace(self, faults: Mapping[str, int]) -> Trace:
        """Everything that was noted, with what the worker knows now. `faults` are those of its alignment."""
        return known_by(self._worker, self._zone, self.course(faults))

    def course(self, faults: Mapping[str, int]) -> Trace:
        """Everything that was noted, without what is known in the end."""
        zone, worker, count = self._zone, self._worker, len(self.rows)
        return Trace(
            zone=zone.id,
            network=worker.network,
            estimator=zone.estimator,
            period=worker.period,
            level=zone.levels[0],
            options=registry.as_mapping(zone.options),
            rows=self.rows,
            inputs=np.array(self._inputs).reshape(count, len(worker.network.inputs)),
            looks=np.array(self._looks, dtype=np.int64),
            parameters=np.array(self._parameters).reshape(-1, len(worker.network.parameters), len(LEVELS)),
            heat_loss=np.array(self._heat_loss).reshape(-1, len(LEVELS)),
            fans=self._fans,
            time_zone=zone.whereabouts.time_zone,
            faults=faults,
        )

    def pack(self) -> dict[str, Array]:
        """What was noted, for a file, without the forecast that waits for its day to pass."""
        fans, nothing = self._fans, np.empty((0, len(LEVELS)))
        return {
            "rows": np.array([values(row) for row in self.rows], dtype=np.float64).reshape(-1, len(HISTORY_COLUMNS)),
            "inputs": np.array(self._inputs),
            "looks": np.array(self._looks, dtype=np.float64),
            "parameters": np.array(self._parameters),
            "heat_loss": np.array(self._heat_loss),
            "fan_times": np.concatenate([np.empty(0), *(fan.times for fan in fans)]),
            "fan_quantiles": np.concatenate([nothing, *(fan.quantiles for fan in fans)]),
            "fan_ends": np.cumsum([len(fan.times) for fan in fans], dtype=np.float64),
        }

    def unpack(self, packed: Mapping[str, Array]) -> None:
        for row in packed["rows"].tolist():
            cells = dict(zip(HISTORY_COLUMNS, row, strict=True))
            whole = {name: int(cells[name]) for name in ("time", "segment")}
            self.rows.append(HistoryRow(**(cells | whole | {"resampled": bool(cells["resampled"])})))
        self._inputs = array("d", packed["inputs"].tolist())
        self._looks = packed["looks"].astype(np.int64).tolist()
        self._parameters, self._heat_loss = list(packed["parameters"]), list(packed["heat_loss"])
        ends = packed["fan_ends"].astype(np.int64)[:-1]
        parts = (np.split(packed[name], ends) for name in ("fan_times", "fan_quantiles"))
        self._fans = [Fan(times.astype(np.int64), found) for times, found in zip(*parts, strict=True) if len(times)]

    def _look(self, update: Update) -> None:
        period = self._worker.period
        every = DAY if self._worker.loop.long_ago(update.time) else EVERY
        if self._worker.estimator.physical and update.time // every != (update.time + period) // every:
            summary = self._worker.parameters(LEVELS)
            if summary is not None:
                self._looks.append(update.time)
                self._parameters.append(summary.parameters)
                self._heat_loss.append(summary.heat_loss)

    def _verify(self, update: Update, held: Array) -> None:
        """Unfold the forecast of this day when the day has passed, and issue that of the next."""
        period, standing = self._worker.period, self._worker.standing
        last = update.time + period
        if self._worker.loop.long_ago(update.time):
            return
        self._followed[update.time] = held
        if self._local(last) % DAY or standing is None:
            return
        sample = self._worker.estimator.issue(standing.state, SAMPLES)
        issue, self._issue = self._issue, _Issue(last, update.segment, sample)
        if issue is not None and issue.segment == update.segment and last - issue.first <= DAY + HOUR:
            self._fans.append(self._unfolded(issue, last))
        self._followed = {}

    def _local(self, time: int) -> int:
        """Seconds of the wall clock at UTC s `time`."""
        name = self._zone.whereabouts.time_zone
        return time if name is None else int(wall_clock(np.array([time]), name)[0])

    def _unfolded(self, issue: _Issue, until: int) -> Fan:
        """What `issue` made of the inputs that followed; one that was missing is held, as the worker did."""
        estimator, period = self._worker.estimator, self._worker.period
        times = np.arange(issue.first, until, period)
        plan, current = [], next(iter(self._followed.values()))
        for when in times[:-1].tolist():
            current = self._followed.get(when, current)
            plan.append(current)
        rows = np.array(plan).reshape(len(times) - 1, len(current))
        driving = self._worker.loop.driving(times[:-1].astype(np.float64), rows)
        mixtures = estimator.unfold(issue.sample, driving).each()
        quantiles = [mixture.quantiles(np.array(LEVELS), 0) for mixture in mixtures]
        return Fan(times, np.array(quantiles))
