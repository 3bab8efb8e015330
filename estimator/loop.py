"""One sample through any estimator: the loop that the daemon, replays, notebooks and experiments share. Pure.

`Loop.step` takes (what is carried, sample) to what is carried to the next sample. It holds inputs, scores the one-step
forecast that stood, assimilates, notes what the model could not explain, restarts after VANISHED_LIMIT such samples,
verifies the forecasts of hours ago and learns from their errors, looks back into the running record and diagnoses when
that is due, and predicts one period on. Time belongs to the caller: which samples follow each other, how old a held
input may be, and what is published.

Forecasts hours ahead are verified twice. `Verification` asks in hindsight what the model is worth once the inputs are
known, `AsIssued` what the forecast was worth as it was issued, with the inputs foreseen then.

`Loop.driving` is the only way from measured, foreseen or planned inputs to the rows that the estimator takes, at a
sample and over a plan alike: heat that is known for any time, such as sun by facade or habits by the hour, is appended
there.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from estimator.arrays import DAY, HOUR, Array
from estimator.diagnosis.diagnose import EVERY, diagnose, due
from estimator.diagnosis.finding import Diagnosis
from estimator.diagnosis.record import Record, no_record, with_sample
from estimator.diagnosis.telemetry import lies
from estimator.diagnosis.telemetry.earlier import Earlier, differ, doubtful_since, keeps, kept, known_at
from estimator.diagnosis.telemetry.recent import Recent, inputs_at, nothing_recent, with_measured
from estimator.foresight import Day, foreseen, no_day, strays, with_inputs
from estimator.heat.known import KnownHeat
from estimator.neighbours import Experience, begun
from estimator.thermostat import thermostat as thermostats
from estimator.thermostat.futures import NOTHING_KNOWN, ToCome
from estimator.thermostat.live import Ahead, Live, LiveForecasts, Now
from estimator.thermostat.thermostat import Thermostat, no_thermostat
from estimator.types import Disturbance, Estimator, Mixture, Outcome, Posterior
from estimator.verification.as_issued import AsIssued, Issued
from estimator.verification.hindsight import issued_at
from estimator.verification.one_step import OneStep, one_step
from estimator.verification.verification import Verification, Verified

VANISHED_LIMIT = 6
"""After this many samples in a row that no particle explains, or of which the forecast said nothing, the thermal states
start anew (a sensor was moved, a room was re-fitted); parameters and volatility are kept."""

ISSUED_DRAWS = 200
"""Draws that a forecast is made of which is verified as it was issued: a sample of those of the published one."""

_LAST_WEEK, _LAST_WEEKS = 8 * DAY, 35 * DAY
"""s at the end of a history: the first is lived through as if nothing had been recorded, for trust looks back on it; of
the second the report tells."""

_SELDOM, _SELDOM_LIVE = 7, (5, 23)
"""In a history, how many times as seldom findings, trust and telemetry are looked at before _LAST_WEEKS, and live
forecasts are made before _LAST_WEEK and before _LAST_WEEKS. Such a forecast stands for as many. None divides a day, so
that every hour of it has its turn."""

UNUSABLE_SD = 10.0
"""K: a forecast with a larger standard deviation says nothing of a room. Nonsense in the telemetry can leave a UKF with
walls so hot and so uncertain that it would take days to come back."""


class Held(NamedTuple):
    """The last measured inputs."""

    values: Array
    """(n_u,): NaN where there was none yet."""
    times: Array
    """(n_u,): when their intervals ended [UTC s]; NaN: never."""


class Standing(NamedTuple):
    """What there is between two samples, once a first one has been taken."""

    state: Any
    """The estimator's, predicted to the next sample."""
    forecast: OneStep
    """Of the next sample."""
    verified: Verified | None
    """What is known of earlier forecasts; None in a loop of single steps."""
    issued: Issued
    """The same of forecasts as they were issued; empty in a loop of single steps."""


class Carried(NamedTuple):
    """Everything that is carried from one sample to the next."""

    held: Held
    day: Day
    """The inputs of the last day."""
    record: Record
    """Sums over the last weeks."""
    recent: Recent
    """What was measured in the last fortnight."""
    thermostat: Thermostat
    """What is known of it."""
    live: Live
    """What live forecasts proved to be worth."""
    suspicions: tuple[lies.Suspicion, ...] = ()
    """What of it cannot be believed."""
    earlier: tuple[Earlier, ...] = ()
    """What had been learned some days ago, the oldest first."""
    diagnosis: Diagnosis = Diagnosis()
    """The newest."""
    vanished: int = 0
    """Measurements in a row that no particle explained, or of which the forecast said nothing."""
    standing: Standing | None = None
    """None before the first sample."""
    experience: Experience | None = None
    """What the estimator begins with; None for a zone that begins alone."""


class Step(NamedTuple):
    """What one sample brought."""

    carried: Carried
    posterior: Posterior
    disturbance: Callable[[], Disturbance] | None
    """That of the posterior, after the step that ended with the sample."""
    started: bool
    """Whether the thermal states began at this sample, which was then not assimilated."""
    scored: OneStep | None
    """The forecast that stood for this sample; None where there was none."""
    ahead: Mixture
    """The distribution of the outputs at the next sample, of which `carried` has the summary."""


class Loop:
    """The loop of one zone. Every method is pure."""

    def __init__(
        self,
        estimator: Estimator,
        seed: int,
        levels: Sequence[float],
        *,
        known_heat: KnownHeat | None = None,
        to_come: ToCome = NOTHING_KNOWN,
        proposes_bounds: bool = False,
        single_steps: bool = False,
    ) -> None:
        """`levels` are those of the intervals of the one-step forecast; `seed` is the estimator's, and spreads what is
        due once in some hours over zones. `known_heat` is needed where the network has terms. With `proposes_bounds`
        the diagnosis proposes narrower ones.

        A loop of `single_steps` neither verifies nor diagnoses, which takes most of the time of a quick filter: for
        experiments that score one step and parameters. Of the estimators only regressions learn from verified errors.
        """
        self.estimator = estimator
        self.history_end = -math.inf
        """UTC s up to which samples are history that nobody lives through. Live forecasts, which cost more than all
        else, are then made seldom before its last week, and before its last weeks nobody waits for findings."""
        self.verification = Verification(estimator)
        self.as_issued = AsIssued(estimator.period)
        self.live = LiveForecasts(estimator, seed, to_come)
        self._known_heat = known_heat
        self._seed = seed
        self._levels = tuple(levels)
        self._proposes_bounds = proposes_bounds
        self._single_steps = single_steps

    def begin(self) -> Carried:
        """Nothing has been seen."""
        width, period = len(self.estimator.network.inputs), int(self.estimator.period)
        return Carried(
            Held(np.full(width, np.nan), np.full(width, np.nan)),
            no_day(width, period),
            no_record(width),
            nothing_recent(width, period),
            no_thermostat(width),
            self.live.begin(),
        )

    def driving(self, times: Array, inputs: Array) -> Array:
        """What drives the estimator over the intervals that begin at `times` (h,) [UTC s], under measured or planned
        `inputs` (h, n_u): rows (h, n_u + m) for `Estimator.predict` and `Estimator.unfold`, of which the m last are the
        known part of each term of the network."""
        return inputs if self._known_heat is None else self._known_heat.drive(times, inputs)

    def hold(self, carried: Carried, time: int, inputs: Array) -> Carried:
        """`carried` with the `inputs` (n_u,) of the interval that begins at `time` [UTC s]; NaN marks a missing one,
        whose last value is held."""
        held, measured = carried.held, ~np.isnan(inputs)
        values = np.where(measured, inputs, held.values)
        times = np.where(measured, float(time + self.estimator.period), held.times)
        return carried._replace(held=Held(values, times))

    def step(
        self, carried: Carried, time: int, outputs: Array, inputs: Array, continues: bool, setpoint: float = math.nan
    ) -> Step:
        """Hold the inputs of a sample and take it."""
        return self.take(self.hold(carried, time, inputs), time, outputs, continues, setpoint)

    def take(self, carried: Carried, time: int, outputs: Array, continues: bool, setpoint: float = math.nan) -> Step:
        """Take the sample at `time` [UTC s] with `outputs` (n_y,), NaN for a missing one, the `setpoint` [degC], NaN
        where nobody tells it, and the inputs that are held, all of which must be known.

        It `continues` where it lies one period after the one before. Otherwise, and after VANISHED_LIMIT samples that
        could not be explained, the thermal states begin at it, and at least one output must be measured.
        """
        estimator, inputs = self.estimator, carried.held.values
        # Of the step that ended with the sample the heat of habits is asked for, which its time alone decides.
        ended, drive = self.driving(np.array([time - self.estimator.period, time]), np.stack([inputs, inputs]))
        posterior, verified, issued, vanished, started = self._assimilated(carried, time, outputs, drive, continues)
        day, before = with_inputs(carried.day, time, inputs), carried.record
        standing, ahead = self._predicted(posterior.state, verified, issued, drive)
        record = with_sample(before, time, estimator.period, float(outputs[0]), inputs)
        after = carried._replace(day=day, record=record, vanished=vanished, standing=standing)
        if not self._single_steps:
            learns = not started and posterior.outcome is not Outcome.VANISHED
            after = self._thermostat(after, time, outputs, setpoint, started=started, learns=learns)
            after = self._watched(self._issued(after, time), time, outputs, drive)
            assert after.standing is not None
            if after.standing.state is not standing.state:
                ahead = estimator.predictive(after.standing.state)
        period, every = int(estimator.period), EVERY * self.seldom(time)
        if not self._single_steps and due(estimator.network, before, record, time, period, self._seed, every):
            after = after._replace(diagnosis=self.diagnose(after))
        scored = carried.standing.forecast if continues and carried.standing is not None else None
        disturbance = None if posterior.disturbance is None else partial(posterior.disturbance, ended)
        return Step(after, posterior, disturbance, started, scored, ahead)

    def _predicted(
        self, state: Any, verified: Verified | None, issued: Issued, drive: Array
    ) -> tuple[Standing, Mixture]:
        """What stands after a sample that led to `state`, one period on, and the distribution of the next sample. The
        estimator and the verification of its forecasts step together: each counts the steps to what is due."""
        state = self.estimator.predict(state, drive)
        if verified is not None:
            verified = self.verification.predict(verified, state, drive, self._seed)
        ahead = self.estimator.predictive(state)
        return Standing(state, one_step(ahead, self._levels), verified, issued), ahead

    def _watched(self, carried: Carried, time: int, outputs: Array, drive: Array) -> Carried:
        """`carried` with what was measured at `time`, looked through once in lies.EVERY s, in a history seldomer;
        when something of it begins or ceases to be suspected, what was learned of it is given up."""
        network, period = self.estimator.network, int(self.estimator.period)
        measured = np.where(carried.held.times == time + period, carried.held.values, np.nan)
        recent = with_measured(carried.recent, time, float(outputs[0]), measured)
        after = carried._replace(recent=recent)
        every, suspicions = lies.EVERY * self.seldom(time), carried.suspicions
        phase = self._seed % every
        looked = (time + phase) // every != (time + period + phase) // every
        if looked:
            suspicions = lies.looked(network, recent, carried.suspicions, time + period, carried.thermostat.memory)
            found = carried.diagnosis._replace(findings=lies.among(carried.diagnosis.findings, network, suspicions))
            recent = lies.believed(network, recent, carried.suspicions, suspicions, time)
            after = after._replace(suspicions=suspicions, diagnosis=found, recent=recent)
        since = doubtful_since(carried.suspicions, suspicions, time)
        if since is not None:
            after = after._replace(thermostat=thermostats.without(after.thermostat, since))
            given_up = known_at(carried.earlier, since) if differ(carried.suspicions, suspicions) else None
            return after if given_up is None else self._gone_back(after, given_up, outputs, drive)
        if not looked or suspicions or carried.standing is None or not keeps(carried.earlier, time):
            return after
        # Its temperatures and what waits for its time would be given up anyway, and are most of a state.
        state = self.estimator.restart(carried.standing.state, self._believable(after, outputs), drive)
        known = Earlier(time, state, self.live.restarted(carried.live))
        return after._replace(earlier=kept(carried.earlier, known))

    def _gone_back(self, carried: Carried, earlier: Earlier, outputs: Array, drive: Array) -> Carried:
        """`carried` with what had been learned `earlier`. The thermal states begin anew at `outputs` (n_y,), or at what
        was forecast of a missing one; no forecast that waits for its time teaches anything."""
        standing = carried.standing
        assert standing is not None
        begin = self._believable(carried, outputs)
        posterior, verified, issued = self._restarted(standing._replace(state=earlier.state), begin, drive)
        standing, _ = self._predicted(posterior.state, verified, issued, drive)
        return carried._replace(standing=standing, vanished=0, live=earlier.live)

    def _believable(self, carried: Carried, outputs: Array) -> Array:
        """`outputs` (n_y,), with what was forecast of a missing one."""
        assert carried.standing is not None
        return np.where(np.isnan(outputs), carried.standing.forecast.mean, outputs)

    def diagnose(self, carried: Carried) -> Diagnosis:
        """What is not known now; empty before the first sample."""
        if carried.standing is None:
            return Diagnosis()
        state, inputs = carried.standing.state, carried.held.values
        found = diagnose(
            self.estimator,
            state,
            carried.record,
            inputs,
            thermostat=carried.thermostat,
            recent=carried.recent,
            driving=self.driving,
            proposes_bounds=self._proposes_bounds,
        )
        return found._replace(findings=lies.among(found.findings, self.estimator.network, carried.suspicions))

    def _thermostat(
        self, carried: Carried, time: int, outputs: Array, setpoint: float, *, started: bool, learns: bool
    ) -> Carried:
        """`carried` to the next sample with what the one at `time` brought of the thermostat and of live forecasts,
        which had foreseen it unless the thermal states `started` anew."""
        estimator, inputs, period = self.estimator, carried.held.values, int(self.estimator.period)
        assert carried.standing is not None
        known, live = carried.thermostat, carried.live
        if started:
            live = self.live.restarted(live)
        elif learns:
            live = self.live.learned(live, known, outputs)
        known = thermostats.with_sample(
            known,
            estimator.network,
            time,
            period,
            setpoint=setpoint,
            temperature=float(outputs[0]),
            inputs=inputs,
            seed=self._seed,
        )

        def ahead(steps: int) -> Ahead:
            return self.ahead(carried, time + period, self._foreseen(carried, time, steps))

        issues = self._issues(time + period)
        now = Now(carried.standing.state, known, inputs, time + period)
        live = self.live.advanced(live, now, ahead if issues else None, self._apart(time + period))
        return carried._replace(thermostat=known, live=live)

    def _issued(self, carried: Carried, time: int) -> Carried:
        """`carried` to the sample after the one at `time` [UTC s], with the forecast that a client without a plan would
        get now, where one is issued."""
        standing, live = carried.standing, carried.live
        assert standing is not None

        def futures(leads: Sequence[int]) -> Sequence[Mixture]:
            told = self.live.issued(live)
            if told is not None:
                return told
            rows = self._foreseen(carried, time, max(leads) - 1)
            fan = self.estimator.unfold(self.estimator.issue(standing.state, ISSUED_DRAWS), rows)
            return [fan.at(lead - 1) for lead in leads]

        now = self._issues(time + int(self.estimator.period))
        issued = self.as_issued.predict(standing.issued, futures if now else None)
        return carried._replace(standing=standing._replace(issued=issued))

    def _issues(self, time: int) -> bool:
        """Whether live forecasts from a state at `time` [UTC s] are made and verified."""
        apart = self._apart(time)
        return issued_at(time, self.estimator.period, self._seed) and time // HOUR % apart == self._seed % apart

    def _apart(self, time: int) -> int:
        """From one live forecast to the next at `time` [UTC s], in those of every hour."""
        if self.long_ago(time):
            return _SELDOM_LIVE[1]
        return _SELDOM_LIVE[0] if time < self.history_end - _LAST_WEEK else 1

    def seldom(self, time: int) -> int:
        """How many times as seldom as usual findings, trust and telemetry are looked at, at `time` [UTC s]."""
        return _SELDOM if self.long_ago(time) else 1

    def long_ago(self, time: int) -> bool:
        """Whether `time` [UTC s] lies in a long history, before its last weeks."""
        return time < self.history_end - _LAST_WEEKS

    def ahead(self, carried: Carried, start: int, rows: Array, known: Sequence[str] = ()) -> Ahead:
        """Drive `rows` (h, n_u + m) from `start` [UTC s] on, in which the inputs `known` are not foreseen by the zone
        itself; beside them those with the heat [W] of the day before, where it was measured."""
        network, ahead = self.estimator.network, self.estimator.period * np.arange(len(rows), dtype=np.float64)
        then = inputs_at(carried.recent, start + ahead % DAY - DAY)
        planned = rows.copy()
        for column, channel in enumerate(network.inputs):
            if channel in network.heat_channels and network.channel_unit(channel) == "W":
                planned[:, column] = np.where(np.isnan(then[:, column]), rows[:, column], then[:, column])
        unsure = [channel not in known for channel in network.inputs]
        return Ahead(rows, planned, np.where(unsure, strays(network, carried.day), 0.0))

    def _foreseen(self, carried: Carried, time: int, steps: int) -> Array:
        """What drives the estimator over `steps` after the sample at `time` [UTC s], as it is foreseen."""
        times = time + self.estimator.period * np.arange(1, steps + 1, dtype=np.float64)
        return self.driving(times, foreseen(self.estimator.network, carried.day, carried.held.values, times).rows)

    def _assimilated(
        self, carried: Carried, time: int, outputs: Array, drive: Array, continues: bool
    ) -> tuple[Posterior, Verified | None, Issued, int, bool]:
        """Assimilate y_k, or begin a segment with it; also what is verified by it, in hindsight and as issued, how many
        samples in a row vanished, and whether a segment began. A forecast that stood for it is verified only where y_k
        is assimilated."""
        estimator, verification, before = self.estimator, self.verification, carried.standing
        if continues and before is not None:
            posterior = estimator.update(before.state, outputs)
            vanished = carried.vanished
            if posterior.outcome is not Outcome.MISSING:
                vanished = vanished + 1 if lost(posterior.outcome, before.forecast.sd.tolist()) else 0
            if vanished < VANISHED_LIMIT:
                verified, issued, state = before.verified, before.issued, posterior.state
                if verified is not None:
                    issued = self.as_issued.update(issued, verified.outputs[:, 0], float(outputs[0]), time)
                    verified, state = verification.update(verified, before.forecast, posterior, outputs, time)
                return posterior._replace(state=state), verified, issued, vanished, False
        if before is None:
            verified = None if self._single_steps else verification.start(self._seed, outputs, drive)
            state = begun(estimator, estimator.start(self._seed, outputs, drive), time, carried.experience)
            posterior = self._begun(state)
            return posterior, verified, self.as_issued.start(), 0, True
        return *self._restarted(before, outputs, drive), 0, True

    def _restarted(self, before: Standing, outputs: Array, drive: Array) -> tuple[Posterior, Verified | None, Issued]:
        """The thermal states begin anew at `outputs` (n_y,), and forecasts that wait for their time are given up."""
        verified = before.verified and self.verification.restart(before.verified, outputs, drive)
        posterior = self._begun(self.estimator.restart(before.state, outputs, drive))
        return posterior, verified, self.as_issued.restart(before.issued)

    def _begun(self, state: Any) -> Posterior:
        """The states start at y itself, so y has nothing more to teach: the update is one without outputs."""
        return self.estimator.update(state, np.full(len(self.estimator.network.measured), np.nan))


def lost(outcome: Outcome, sds: Iterable[float]) -> bool:
    """Whether an update shows that the states are of no use; `sds` (K) are those of the forecast of each output."""
    return outcome is Outcome.VANISHED or (outcome is Outcome.ASSIMILATED and max(sds) > UNUSABLE_SD)
