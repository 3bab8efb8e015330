"""One zone's estimator at work: samples in, updates out, synchronous and deterministic.

On sample k the worker scores the standing forecast against y_k, assimilates y_k, and propagates to t_(k+1) under u_k
held over the step; what it publishes is exactly what the next sample scores. The daemon and `thermogate replay` run
this same worker.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from adapters.reading import Quality
from estimator.arrays import Array
from estimator.diagnosis.diagnose import diagnose, due
from estimator.diagnosis.finding import Diagnosis
from estimator.diagnosis.record import Record, no_record, with_sample
from estimator.network.network import Network
from estimator.statespace.matrices import of_draws, of_point
from estimator.statespace.simulate import Simulation, gain_forecast, sampled_paths
from estimator.types import Estimator, Mixture, Mixtures, ModelDraws, Outcome, ParameterSummary, Posterior
from estimator.verification.summaries import summary
from service.errors import NoModel, ServiceError
from service.records.fan import Fan, FanStep
from service.records.model import CompactFan, CompactOutput, ZoneModel
from service.records.outlook import Outlook, Weather
from service.records.sample import Sample
from service.records.skill import Skill
from service.records.trust import Trust
from service.records.update import (
    Disturbance,
    Forecast,
    Gate,
    InputUsed,
    Interval,
    OutputForecast,
    Score,
    Update,
    Volatility,
)
from service.zone.foresight.outlook import NO_WEATHER, Foresight
from service.zone.foresight.yesterday import Day, no_day, with_inputs
from service.zone.trust import judged
from service.zone.verification import Verification, Verified

VANISHED_LIMIT = 6
"""After this many samples in a row that no particle explains, or of which the forecast said nothing, the thermal states
start anew (a sensor was moved, a room was re-fitted); parameters and volatility are kept."""

UNUSABLE_SD = 10.0
"""K: a forecast with a larger standard deviation says nothing of a room. Nonsense in the telemetry can leave a UKF with
walls so hot and so uncertain that it would take days to come back."""

FAN_DRAWS = 1000
"""Particles that a compact fan stands on at most."""

FAN_COMPONENTS = 96
"""Components of a mixture that the quantiles of a compact fan are found in at most."""

_AT_ONCE = 100
"""Steps of a compact fan between two questions whether anybody still waits for it."""

ROOM_DRAWS = 32
"""Draws whose mean stands for a room that is simulated with its neighbours."""

GIVEN_UP = "the forecast was given up because the daemon is stopping, or nobody waits for it"

STARTED = "started"

_DAY = 86400
_HOUR = 3600


class WorkerSettings(NamedTuple):
    """How a zone treats its samples."""

    seed: int
    levels: tuple[float, ...]
    """Levels of the published intervals; the first is the one that is scored."""
    max_gap: int
    """Steps without a measured output that prediction bridges."""
    hold_inputs: float
    """Age in s up to which a missing input keeps its last value."""
    max_ages: Mapping[str, float] = {}
    """The same for the inputs that have an age of their own."""
    proposes_bounds: bool = False
    """Whether narrower bounds are proposed once a week of data supports them."""


class Held(NamedTuple):
    """The last measured inputs (n_u,), the UTC s when their intervals ended (NaN: never), and their qualities."""

    values: Array
    times: Array
    qualities: tuple[Quality, ...]


class Known(NamedTuple):
    """What is told of a zone's model beside its forecasts: the running record behind it, the newest diagnosis, and how
    far the forecasts are trusted."""

    record: Record
    diagnosis: Diagnosis = Diagnosis()
    trust: Trust = Trust()


class Progress(NamedTuple):
    """How far a worker has come."""

    last_time: int | None = None
    """Time of the last sample, UTC s."""
    samples: int = 0
    segment: int = 0
    missing: int = 0
    """Steps in a row without a measured output."""
    vanished: int = 0
    """Measurements in a row that no particle explained, or of which the forecast said nothing."""
    stalled: str | None = None
    """Why there is no standing forecast, or None."""


class Standing(NamedTuple):
    """The estimator's state, predicted to the next sample, and the update whose forecast it carries."""

    state: Any
    update: Update
    verified: Verified
    """What is known of earlier forecasts."""
    day: Day
    """The inputs of the last day."""


class ZoneWorker:
    """The state of one zone between two samples, and `step`, which takes it over one."""

    def __init__(self, estimator: Estimator, settings: WorkerSettings) -> None:
        self.estimator = estimator
        self.settings = settings
        width = len(estimator.network.inputs)
        self.held = _nothing_held(width)
        self.verification = Verification(estimator)
        self.foresight = Foresight(estimator.network, self.period)
        self.standing: Standing | None = None
        """One attribute, replaced whole, so that another thread never sees a state beside another sample's forecast."""
        self.progress = Progress()
        self.known = Known(no_record(width))

    @property
    def network(self) -> Network:
        """The zone's network."""
        return self.estimator.network

    @property
    def period(self) -> int:
        """Sampling period in s."""
        return int(self.estimator.period)

    @property
    def latest(self) -> Update | None:
        """The newest update; None before the first sample."""
        return None if self.standing is None else self.standing.update

    @property
    def empty_samples(self) -> int:
        """How many samples in a row, up to the last one, had no reading of any channel."""
        progress, measured = self.progress, self.held.times[~np.isnan(self.held.times)]
        if progress.last_time is None or not measured.size:
            return progress.missing
        return min(progress.missing, int(progress.last_time + self.period - measured.max()) // self.period)

    def anew(self) -> ZoneWorker:
        """A worker of the same zone that has seen nothing."""
        return ZoneWorker(self.estimator, self.settings)

    def resume(self, standing: Standing, held: Held, progress: Progress, known: Known | None = None) -> None:
        """Go on from where another worker of this zone stood; what it has `known` begins anew if that is not there."""
        self.standing, self.held, self.progress = standing, held, progress
        self.known = known or self.known

    def set_back(self, last_time: int, why: str) -> None:
        """The clock was set back, `why` says it: the sample at `last_time` (UTC s) counts as the last one.

        What was learned is kept. Held inputs are not, whose age nobody knows; the next sample starts a segment.
        """
        self.held = _nothing_held(len(self.network.inputs))
        self.progress = self.progress._replace(last_time=last_time, missing=0, vanished=0, stalled=why)

    def step(self, sample: Sample) -> Update | None:
        """Take one sample; None where it could not be used (`stalled` then says why).

        Samples come in strictly increasing time. Intervals that are missing altogether count as samples without
        readings.
        """
        last = self.progress.last_time
        if last is not None:
            if sample.time <= last:
                raise ValueError(f"sample {sample.time} does not follow {last}")
            self._bridge(last, sample.time)
        return self._step(sample)

    def fan(
        self,
        levels: Sequence[float],
        plan: Sequence[Mapping[str, float]],
        given_up: Callable[[], bool] = lambda: False,
        weather: Weather = NO_WEATHER,
    ) -> Fan | None:
        """The standing forecast and `len(plan)` steps beyond it; a row of `plan` names the inputs that it plans.

        The others are foreseen (`service.zone.foresight`). Volatility is sampled along every particle's path. None
        where there is no standing forecast. `given_up` is asked after every step; ServiceError once it says yes.
        """
        standing = self._unstalled()
        if standing is None:
            return None
        state, update = standing.state, standing.update
        rows, origins = self.foresight.outlook(update.forecast, standing.day, len(plan), weather).under(plan)
        first, steps = update.forecast.valid_time, []
        for ahead, mixture in enumerate(self.estimator.forecast(state, rows)):
            steps.append(FanStep(first + ahead * self.period, self._outputs(mixture, levels)))
            if given_up():
                raise ServiceError(GIVEN_UP)
        return Fan(update.time, update.forecast.issue_time, tuple(steps), update.forecast.inputs, update, origins)

    def outlook(self, steps: int, weather: Weather = NO_WEATHER) -> tuple[Update, Outlook] | None:
        """The newest update, and the inputs of `steps` steps from its forecast on as far as they are foreseen without
        a plan; None where there is no standing forecast."""
        standing = self._unstalled()
        if standing is None:
            return None
        return standing.update, self.foresight.outlook(standing.update.forecast, standing.day, steps, weather)

    def compact_fan(
        self,
        update: Update,
        levels: Sequence[float],
        rows: Array,
        scenarios: int = 0,
        given_up: Callable[[], bool] = lambda: False,
    ) -> CompactFan | None:
        """The standing forecast of `update` and the steps under `rows` (h, n_u), on a sample of the particles, with as
        many sampled futures as `scenarios` says. None where `update` is no longer the newest.

        Raises NoModel for scenarios of an estimator without physics.
        """
        standing = self._unstalled()
        if standing is None or standing.update is not update:
            return None
        estimator, state = self.estimator, standing.state
        tails = np.array([0.5, *(0.5 - level / 2 for level in levels), *(0.5 + level / 2 for level in levels)])
        fan = estimator.unfold(estimator.issue(state, FAN_DRAWS), rows)
        # The first step is the published forecast, of all particles.
        told = [summary(Mixtures.of_one(estimator.predictive(state)), tails, FAN_COMPONENTS)]
        for first in range(1, len(rows) + 1, _AT_ONCE):
            if given_up():
                raise ServiceError(GIVEN_UP)
            told.append(summary(fan.during(slice(first, first + _AT_ONCE)), tails, FAN_COMPONENTS))
        means, sds, quantiles = (np.concatenate(parts) for parts in zip(*told, strict=True))
        count = len(levels)
        outputs = tuple(
            CompactOutput(
                name,
                means[:, place],
                quantiles[:, place, 0],
                sds[:, place],
                quantiles[:, place, 1 : 1 + count].T,
                quantiles[:, place, 1 + count :].T,
            )
            for place, name in enumerate(self.network.measured)
        )
        return CompactFan(update, outputs, self._scenarios(standing, rows, scenarios))

    def room(self, update: Update) -> Simulation | None:
        """The zone's physics from the standing forecast of `update` on, to be simulated with its neighbours; None where
        there are none, or `update` is no longer the newest."""
        standing = self._unstalled()
        if standing is None or standing.update is not update:
            return None
        draws = self.estimator.draws(standing.state, ROOM_DRAWS)
        return None if draws is None else Simulation(of_draws(draws, self.period, 1))

    def model(self, periods: int, count: int) -> ZoneModel | None:
        """State-space matrices at a step of `periods` periods: at the posterior mean, and of at most `count` draws.

        None where there is no standing forecast. Raises NoModel for an estimator without physics.
        """
        standing = self._unstalled()
        if standing is None:
            return None
        drawn = self._drawn(standing, count)
        draws = of_draws(drawn, self.period, periods)
        return ZoneModel(
            update=standing.update,
            step=self.period * periods,
            member=drawn.member,
            share=drawn.share,
            fan_is="mean" if drawn.point_is_fan else "draws",
            mean=of_point(drawn, self.period, periods),
            draws=draws,
            covariance=drawn.covariance,
            gain=gain_forecast(draws, _DAY // (self.period * periods)),
        )

    def _scenarios(self, standing: Standing, rows: Array, count: int) -> Array:
        """(count, h + 1, n_y): sampled futures under `rows` (h, n_u)."""
        if count == 0:
            return np.empty((0, len(rows) + 1, len(self.network.measured)))
        own = getattr(self.estimator, "scenarios", None)
        if own is not None:
            paths: Array = own(standing.state, rows, count)
            return paths
        origin = standing.update.time // self.period
        return sampled_paths(self._drawn(standing, count), self.period, rows, self.settings.seed, origin)

    def _drawn(self, standing: Standing, count: int) -> ModelDraws:
        draws = self.estimator.draws(standing.state, count)
        if draws is None:
            raise NoModel("it knows no physics, so it has no state-space model and no scenarios; its forecasts it has")
        return draws

    def _unstalled(self) -> Standing | None:
        """What a forecast starts from; None where there is none now."""
        standing = self.standing
        return None if standing is None or self.progress.stalled else standing

    def parameters(self, levels: Sequence[float]) -> ParameterSummary | None:
        """Posterior quantiles of the parameters; None before the first sample."""
        standing = self.standing
        return None if standing is None else self.estimator.parameters(standing.state, np.array(levels))

    def heat_loss(self, levels: Sequence[float]) -> list[float] | None:
        """Posterior quantiles of the heat-loss coefficient, W/K; None before the first sample, and for an estimator
        that does not know of any."""
        summary = self.parameters(levels)
        known = summary is not None and bool(np.isfinite(summary.heat_loss).all())
        return summary.heat_loss.tolist() if summary is not None and known else None

    def skill(self) -> Skill | None:
        """What the zone's forecasts have been worth; None before the first sample."""
        standing = self.standing
        return (
            None
            if standing is None
            else self.verification.skill(standing.verified, standing.state, standing.update.time)
        )

    def diagnosis(self) -> Diagnosis:
        """What is not known now; empty before the first sample."""
        if self.standing is None:
            return Diagnosis()
        proposes = self.settings.proposes_bounds
        record, inputs = self.known.record, self.held.values
        return diagnose(self.estimator, self.standing.state, record, inputs, proposes_bounds=proposes)

    def _bridge(self, last: int, until: int) -> None:
        """Step through the whole missing intervals between two samples, as far as they can be bridged."""
        empty = Sample(
            0,
            np.full(len(self.network.measured), np.nan),
            np.full(len(self.network.inputs), np.nan),
            (Quality.BAD,) * len(self.network.measured),
            (Quality.BAD,) * len(self.network.inputs),
        )
        for when in range(last + self.period, until, self.period):
            if self.progress.stalled:
                break
            self._step(empty._replace(time=when))

    def _step(self, sample: Sample) -> Update | None:
        """One step, or nothing of one that fails: what a checkpoint holds must not run ahead of what was learned."""
        before = self.held, self.standing, self.progress, self.known
        try:
            return self._taken(sample)
        except BaseException:
            self.held, self.standing, self.progress, self.known = before
            raise

    def _taken(self, sample: Sample) -> Update | None:
        began = time.perf_counter()
        before, end = self.progress, sample.time + self.period
        continues = before.last_time == sample.time - self.period and not before.stalled
        measured = not np.isnan(sample.outputs).all()
        missing = 0 if measured else before.missing + 1
        self.held = _hold(self.held, sample, end)
        stalled = self._unusable_inputs(end)
        if stalled is None and not measured and (missing > self.settings.max_gap or not continues):
            stalled = f"no measurement of {', '.join(self.network.measured)} for {missing} steps of {self.period} s"
        self.progress = before._replace(last_time=sample.time, missing=missing, stalled=stalled)
        if stalled is not None:
            return None
        posterior, score, verified = self._assimilate(sample, continues)
        state = self.estimator.predict(posterior.state, self.held.values)
        verified = self.verification.predict(verified, state, self.held.values, self.settings.seed)
        started = self.progress.segment > before.segment
        update = self._update(sample, posterior, STARTED if started else str(posterior.outcome), score, state, began)
        day = self.standing.day if self.standing is not None else no_day(len(self.network.inputs), self.period)
        self.standing = Standing(state, update, verified, with_inputs(day, sample.time, self.held.values))
        self.progress = self.progress._replace(samples=before.samples + 1)
        self._look_back(sample)
        self._judge(update)
        return update

    def _judge(self, update: Update) -> None:
        """Judge how far the forecasts are trusted: by what was verified once an hour, by this moment always."""
        before, skill = self.known.trust, None
        if not before.horizons or update.time // _HOUR != before.time // _HOUR:
            skill = self.skill()
        self.known = self.known._replace(trust=judged(before, update, skill, self.known.diagnosis))

    def _look_back(self, sample: Sample) -> None:
        """Take the sample into the record, and make a new diagnosis if one is due."""
        before = self.known.record
        record = with_sample(before, sample.time, self.period, float(sample.outputs[0]), self.held.values)
        self.known = self.known._replace(record=record)
        if due(self.network, before, record, sample.time, self.period, self.settings.seed):
            self.known = self.known._replace(diagnosis=self.diagnosis())

    def _assimilate(self, sample: Sample, continues: bool) -> tuple[Posterior, Score | None, Verified]:
        """Score and assimilate y_k, or begin a segment with it; a forecast that stood for it is scored either way."""
        score, verification = None, self.verification
        if continues and self.standing is not None:
            score = _score(self.standing.update.forecast, sample)
            posterior = self.estimator.update(self.standing.state, sample.outputs)
            vanished = self.progress.vanished
            if posterior.outcome is not Outcome.MISSING:
                sds = [output.sd for output in self.standing.update.forecast.outputs]
                vanished = vanished + 1 if lost(posterior.outcome, sds) else 0
            self.progress = self.progress._replace(vanished=vanished)
            if vanished < VANISHED_LIMIT:
                published, before = self.standing.update.forecast, self.standing.verified
                verified, state = verification.update(before, published, posterior, sample.outputs, sample.time)
                return posterior._replace(state=state), score, verified
        self.progress = self.progress._replace(vanished=0, segment=self.progress.segment + 1)
        inputs = self.held.values
        if self.standing is None:
            state = self.estimator.start(self.settings.seed, sample.outputs, inputs)
            verified = verification.start(self.settings.seed, sample.outputs, inputs)
        else:
            state = self.estimator.restart(self.standing.state, sample.outputs, inputs)
            verified = verification.restart(self.standing.verified, sample.outputs, inputs)
        # The states start at y itself, so y has nothing more to teach: the update is one without outputs.
        return self.estimator.update(state, np.full(len(sample.outputs), np.nan)), score, verified

    def _unusable_inputs(self, now: int) -> str | None:
        """Why the inputs cannot carry a prediction at UTC time `now`, or None."""
        for channel, value, when in zip(self.network.inputs, self.held.values, self.held.times, strict=True):
            if np.isnan(value):
                return f"no reading of {channel} yet"
            oldest = self.settings.max_ages.get(channel, self.settings.hold_inputs)
            if now - when > oldest:
                key = "its max_age" if channel in self.settings.max_ages else "hold_inputs"
                return f"{channel} is {now - when:.0f} s old, older than {key} = {oldest:.0f} s"
        return None

    def _update(
        self, sample: Sample, posterior: Posterior, outcome: str, score: Score | None, state: Any, began: float
    ) -> Update:
        lower, median, upper = (tuple(map(float, column)) for column in posterior.alpha_quantiles.T)
        return Update(
            time=sample.time,
            segment=self.progress.segment,
            outcome=outcome,
            y=tuple(map(float, sample.outputs)),
            score=score,
            volatility=Volatility(self.estimator.blocks, lower, median, upper, tuple(map(float, posterior.cdf))),
            gate=None if posterior.gate is None or posterior.regime is None else Gate(posterior.gate, posterior.regime),
            effective_sample_size=posterior.effective_sample_size,
            resampled=posterior.resampled,
            floored=posterior.floored,
            log_likelihood=posterior.log_likelihood,
            parameters=tuple(map(float, posterior.parameters)),
            forecast=self._forecast(sample.time, state),
            step_seconds=time.perf_counter() - began,
            disturbance=_disturbance(posterior),
            setpoint=sample.setpoint,
        )

    def _forecast(self, sample_time: int, state: Any) -> Forecast:
        mixture = self.estimator.predictive(state)
        issue = sample_time + self.period
        inputs = tuple(
            InputUsed(channel, value, self.network.channel_unit(channel), issue - when, quality, issue > when)
            for channel, value, when, quality in zip(
                self.network.inputs,
                self.held.values.tolist(),
                self.held.times.tolist(),
                self.held.qualities,
                strict=True,
            )
        )
        return Forecast(sample_time, issue, issue, self._outputs(mixture, self.settings.levels), inputs)

    def _outputs(self, mixture: Mixture, levels: Sequence[float]) -> tuple[OutputForecast, ...]:
        mean, sd = mixture.mean(), mixture.sd()
        tails = np.array([0.5, *(0.5 - level / 2 for level in levels), *(0.5 + level / 2 for level in levels)])
        forecasts = []
        for index, name in enumerate(self.network.measured):
            median, *bounds = self.estimator.quantiles(mixture, tails, index).tolist()
            lower, upper = bounds[: len(levels)], bounds[len(levels) :]
            intervals = tuple(map(Interval, levels, lower, upper))
            forecasts.append(OutputForecast(name, float(mean[index]), median, float(sd[index]), intervals))
        return tuple(forecasts)


def _disturbance(posterior: Posterior) -> Disturbance | None:
    if posterior.disturbance is None:
        return None
    known = posterior.disturbance()
    lower, median, upper = known.gain.tolist()
    return Disturbance((lower, median, upper), known.probability_on, tuple(map(tuple, known.measurement_sd.tolist())))


def _nothing_held(width: int) -> Held:
    return Held(np.full(width, np.nan), np.full(width, np.nan), (Quality.BAD,) * width)


def _hold(held: Held, sample: Sample, end: int) -> Held:
    """The held inputs after a sample whose interval ended at `end`."""
    measured = ~np.isnan(sample.inputs)
    return Held(
        np.where(measured, sample.inputs, held.values),
        np.where(measured, float(end), held.times),
        tuple(
            new if fresh else old
            for fresh, new, old in zip(measured, sample.input_quality, held.qualities, strict=True)
        ),
    )


def lost(outcome: Outcome, sds: Iterable[float]) -> bool:
    """Whether an update shows that the states are of no use; `sds` (K) are those of the forecast of each output."""
    return outcome is Outcome.VANISHED or (outcome is Outcome.ASSIMILATED and max(sds) > UNUSABLE_SD)


def _score(forecast: Forecast, sample: Sample) -> Score:
    """The published forecast against y_k, at its first level."""
    intervals = [output.intervals[0] for output in forecast.outputs]
    return Score(
        y=tuple(map(float, sample.outputs)),
        mean=tuple(output.mean for output in forecast.outputs),
        sd=tuple(output.sd for output in forecast.outputs),
        lower=tuple(interval.lower for interval in intervals),
        upper=tuple(interval.upper for interval in intervals),
        residual=tuple(float(y) - output.mean for y, output in zip(sample.outputs, forecast.outputs, strict=True)),
        level=intervals[0].level,
    )
