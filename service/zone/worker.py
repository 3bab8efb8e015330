"""One zone's estimator at work: samples in, updates out, synchronous and deterministic. The worker is
`estimator.loop.Loop` in time: it decides which sample continues a segment, which inputs are too old to be held and when
the zone stalls, and states what the loop has found as the records that are published. What it publishes is exactly what
the next sample scores. The daemon and `thermogate replay` run this same worker."""

import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from adapters.reading import Quality
from estimator.believed import believed
from estimator.diagnosis.finding import Diagnosis
from estimator.heat.known import KnownHeat
from estimator.loop import Carried, Loop, Step
from estimator.network.network import Network
from estimator.thermostat.futures import NOTHING_KNOWN, ToCome
from estimator.types import Estimator, ParameterSummary
from estimator.verification.one_step import OneStep
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
from service.zone.skill import skill_of
from service.zone.trust import LOOKED_BACK, judged

STARTED = "started"

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
    """What the loop carries to the next sample, and the update whose forecast it holds."""

    carried: Carried
    update: Update

    @property
    def state(self) -> Any:
        """The estimator's, predicted to the next sample."""
        assert self.carried.standing is not None
        return self.carried.standing.state


class ZoneWorker:
    """The state of one zone between two samples, and `step`, which takes it over one."""

    def __init__(
        self,
        estimator: Estimator,
        settings: WorkerSettings,
        known_heat: KnownHeat | None = None,
        to_come: ToCome = NOTHING_KNOWN,
    ) -> None:
        """`known_heat` is needed where the estimator's network has terms."""
        self.estimator = estimator
        self.settings = settings
        self._known_heat, self._to_come = known_heat, to_come
        self.loop = Loop(
            estimator,
            settings.seed,
            settings.levels,
            known_heat=known_heat,
            to_come=to_come,
            proposes_bounds=settings.proposes_bounds,
        )
        self.carried = self.loop.begin()
        self.input_quality = (Quality.BAD,) * len(estimator.network.inputs)
        """Of the inputs that are held."""
        self.standing: Standing | None = None
        """One attribute, replaced whole, so that another thread never sees a state beside another sample's forecast."""
        self.progress = Progress()
        self.trust = Trust()
        """How far the forecasts are trusted."""

    @property
    def network(self) -> Network:
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
        progress, times = self.progress, self.carried.held.times
        measured = times[~np.isnan(times)]
        if progress.last_time is None or not measured.size:
            return progress.missing
        return min(progress.missing, int(progress.last_time + self.period - measured.max()) // self.period)

    def anew(self) -> "ZoneWorker":
        """A worker of the same zone that has seen nothing."""
        return ZoneWorker(self.estimator, self.settings, self._known_heat, self._to_come)

    def resume(self, standing: Standing, input_quality: tuple[Quality, ...], progress: Progress, trust: Trust) -> None:
        """Go on from where another worker of this zone stood."""
        self.carried, self.standing, self.progress, self.trust = standing.carried, standing, progress, trust
        self.input_quality = input_quality

    def set_back(self, last_time: int, why: str) -> None:
        """The clock was set back, `why` says it: the sample at `last_time` (UTC s) counts as the last one. What was
        learned is kept, but for held inputs, whose age nobody knows; the next sample starts a segment."""
        self.carried = self.carried._replace(held=self.loop.begin().held, vanished=0)
        self.input_quality = (Quality.BAD,) * len(self.network.inputs)
        self.progress = self.progress._replace(last_time=last_time, missing=0, vanished=0, stalled=why)

    def step(self, sample: Sample) -> Update | None:
        """Take one sample, later than the last; None where it could not be used (`stalled` then says why). Intervals
        that are missing altogether count as samples without readings."""
        last = self.progress.last_time
        if last is not None:
            if sample.time <= last:
                raise ValueError(f"sample {sample.time} does not follow {last}")
            if sample.time > last + self.period:
                self._bridge(last, sample.time)
        return self._step(sample)

    @property
    def unstalled(self) -> Standing | None:
        """What a forecast starts from; None where there is none now."""
        standing = self.standing
        return None if standing is None or self.progress.stalled else standing

    def parameters(self, levels: Sequence[float]) -> ParameterSummary | None:
        """Posterior quantiles of the parameters, collapsed intervals marked; None before the first sample."""
        standing = self.standing
        return None if standing is None else believed(self.estimator, standing.state, np.array(levels, dtype=float))

    def heat_loss(self, levels: Sequence[float]) -> list[float] | None:
        """Posterior quantiles of the heat-loss coefficient, W/K; None before the first sample, and for an estimator
        that does not know of any."""
        summary = self.parameters(levels)
        known = summary is not None and bool(np.isfinite(summary.heat_loss).all())
        return summary.heat_loss.tolist() if summary is not None and known else None

    def skill(self) -> Skill | None:
        """What the zone's forecasts have been worth; None before the first sample."""
        standing = self.standing
        return None if standing is None else skill_of(self.loop, standing.carried, standing.update.time)

    def diagnosis(self) -> Diagnosis:
        """What is not known now; empty before the first sample."""
        return self.loop.diagnose(self.carried)

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
        began = time.perf_counter()
        before, end = self.progress, sample.time + self.period
        continues = before.last_time == sample.time - self.period and not before.stalled
        measured = not np.isnan(sample.outputs).all()
        missing = 0 if measured else before.missing + 1
        carried = self.loop.hold(self.carried, sample.time, sample.inputs)
        quality = tuple(
            held if np.isnan(value) else new
            for value, new, held in zip(sample.inputs, sample.input_quality, self.input_quality, strict=True)
        )
        stalled = self._unusable_inputs(carried, end)
        if stalled is None and not measured and (missing > self.settings.max_gap or not continues):
            stalled = f"no measurement of {', '.join(self.network.measured)} for {missing} steps of {self.period} s"
        progress = before._replace(last_time=sample.time, missing=missing, stalled=stalled)
        if stalled is not None:
            self.carried, self.input_quality, self.progress = carried, quality, progress
            return None
        step = self.loop.take(carried, sample.time, sample.outputs, continues, sample.setpoint)
        progress = progress._replace(
            samples=before.samples + 1, segment=before.segment + step.started, vanished=step.carried.vanished
        )
        update = self._update(sample, step, quality, progress.segment, began)
        trust = self._judged(step.carried, update)
        self.carried, self.input_quality, self.progress, self.trust = step.carried, quality, progress, trust
        self.standing = Standing(step.carried, update)
        return update

    def _judged(self, carried: Carried, update: Update) -> Trust:
        """How far the forecasts are trusted: by what was verified once an hour, by this moment always."""
        before, skill, every = self.trust, None, _HOUR * self.loop.seldom(update.time)
        if not before.horizons or update.time // every != before.time // every:
            skill = skill_of(self.loop, carried, update.time, LOOKED_BACK)
        return judged(before, update, skill, carried.diagnosis)

    def _unusable_inputs(self, carried: Carried, now: int) -> str | None:
        """Why the inputs that are held cannot carry a prediction at UTC time `now`, or None."""
        held = carried.held
        for channel, value, when in zip(self.network.inputs, held.values, held.times, strict=True):
            if np.isnan(value):
                return f"no reading of {channel} yet"
            oldest = self.settings.max_ages.get(channel, self.settings.hold_inputs)
            if now - when > oldest:
                key = "its max_age" if channel in self.settings.max_ages else "hold_inputs"
                return f"{channel} is {now - when:.0f} s old, older than {key} = {oldest:.0f} s"
        return None

    def _update(
        self, sample: Sample, step: Step, input_quality: tuple[Quality, ...], segment: int, began: float
    ) -> Update:
        posterior = step.posterior
        lower, median, upper = (tuple(map(float, column)) for column in posterior.alpha_quantiles.T)
        return Update(
            time=sample.time,
            segment=segment,
            outcome=STARTED if step.started else str(posterior.outcome),
            y=tuple(map(float, sample.outputs)),
            score=None if step.scored is None else _score(step.scored, sample),
            volatility=Volatility(self.estimator.blocks, lower, median, upper, tuple(map(float, posterior.cdf))),
            gate=_gate(step),
            effective_sample_size=posterior.effective_sample_size,
            resampled=posterior.resampled,
            floored=posterior.floored,
            log_likelihood=posterior.log_likelihood,
            parameters=tuple(map(float, posterior.parameters)),
            forecast=self._forecast(sample.time, step.carried, input_quality),
            step_seconds=time.perf_counter() - began,
            disturbance=_disturbance(step),
            setpoint=sample.setpoint,
        )

    def _forecast(self, sample_time: int, carried: Carried, input_quality: tuple[Quality, ...]) -> Forecast:
        assert carried.standing is not None
        issue = sample_time + self.period
        inputs = tuple(
            InputUsed(channel, value, self.network.channel_unit(channel), issue - when, quality, issue > when)
            for channel, value, when, quality in zip(
                self.network.inputs,
                carried.held.values.tolist(),
                carried.held.times.tolist(),
                input_quality,
                strict=True,
            )
        )
        found = carried.standing.forecast
        columns = (column.tolist() for column in (found.mean, found.median, found.sd, found.lower, found.upper))
        outputs = tuple(
            OutputForecast(name, mean, median, sd, tuple(map(Interval, found.levels, lower, upper)))
            for name, mean, median, sd, lower, upper in zip(self.network.measured, *columns, strict=True)
        )
        return Forecast(sample_time, issue, issue, outputs, inputs)


def stated(forecast: Forecast) -> OneStep:
    """A published forecast as the loop holds it."""
    outputs = forecast.outputs
    return OneStep(
        levels=tuple(interval.level for interval in outputs[0].intervals),
        mean=np.array([output.mean for output in outputs]),
        sd=np.array([output.sd for output in outputs]),
        median=np.array([output.median for output in outputs]),
        lower=np.array([[interval.lower for interval in output.intervals] for output in outputs]),
        upper=np.array([[interval.upper for interval in output.intervals] for output in outputs]),
    )


def _gate(step: Step) -> Gate | None:
    """The gate of a sample, which is closed while the telemetry is not believed: what is learned then is given up."""
    value, regime = step.posterior.gate, step.posterior.regime
    if value is None or regime is None:
        return None
    return Gate(0.0 if step.carried.suspicions else value, regime)


def _disturbance(step: Step) -> Disturbance | None:
    if step.disturbance is None:
        return None
    known = step.disturbance()
    lower, median, upper = known.gain.tolist()
    return Disturbance((lower, median, upper), known.probability_on, tuple(map(tuple, known.measurement_sd.tolist())))


def _score(forecast: OneStep, sample: Sample) -> Score:
    """The published forecast against y_k, at its first level."""
    mean = tuple(forecast.mean.tolist())
    y = tuple(map(float, sample.outputs))
    return Score(
        y=y,
        mean=mean,
        sd=tuple(forecast.sd.tolist()),
        lower=tuple(forecast.lower[:, 0].tolist()),
        upper=tuple(forecast.upper[:, 0].tolist()),
        residual=tuple(value - expected for value, expected in zip(y, mean, strict=True)),
        level=forecast.levels[0],
    )
