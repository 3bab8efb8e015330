"""What a zone tells on REST, Zenoh and MQTT alike, as records made from its updates and its status."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, Self, TypeVar

import numpy as np

from adapters.reading import Quality
from adapters.units import default_valid_range
from estimator.diagnosis.finding import TELEMETRY, Finding
from estimator.types import ALPHA_LEVELS, Outcome
from estimator.verification.hindsight import HORIZONS
from service.records.fan import CompactOutputPayload, Fan
from service.records.outlook import InputOrigin
from service.records.record import Moment, Number, Time, Vector, constant, record, shown, values
from service.records.status import ZoneStatus
from service.records.update import InputUsed, Interval, OutputForecast, Update

Limits = Mapping[str, tuple[float, float]]
NO_LIMITS: Limits = {}

_WORST_LAST = (Quality.GOOD, Quality.UNCERTAIN, Quality.BAD)
_OUTCOME_QUALITY: Mapping[str, Quality] = {Outcome.MISSING: Quality.UNCERTAIN, Outcome.VANISHED: Quality.BAD}
_GATE = "learning gate g_k: how much the parameters may move now, 0 to 1"
_REGIME = "low, transitional or high volatility; constant where there is none"
_N_EFF = "effective sample size, particles; null where the estimator has none"
_VOLATILITY = "null where the estimator has no volatility (ekf, ukf)"
_QUALITY = "whether inputs and measurements arrived: the worst of the inputs' and what became of the last sample"
_SUSPECTED = "findings about what arrived, which is not to be believed while there are any"
_LEVELS = "levels of lower, median and upper"
AHEAD_STEP = 1800
"""s from one value of the fan that is published to the next."""
SHORT_PERIOD, USUAL_PERIOD = 30.0, 300
"""s; zones with periods shorter than the first, such as those of a simulation in a hurry, look as many periods ahead
and back as zones of the second would: a day of seconds is too much to forecast, and not what such a zone is about."""


@record
class BlockPayload:
    """Quantiles of the volatility alpha of one block, and where its median stands in its own history."""

    block: str
    lower: Number = shown("quantile of alpha at levels[0]; dimensionless")
    median: Number = shown("median of alpha; dimensionless")
    upper: Number = shown("quantile of alpha at levels[2]; dimensionless")
    cdf: Number = shown("F_k: share of past medians below the present one, 0 to 1")


@record
class AlphaPayload(BlockPayload):
    """The volatility alpha: the first block, and all of them in `blocks`. 1 is the model's nominal process noise."""

    levels: tuple[float, ...] = shown(_LEVELS)
    unit: Literal["1"] = constant("1")
    blocks: tuple[BlockPayload, ...]

    @classmethod
    def of(cls, update: Update) -> Self | None:
        """The volatility in `update`; None where the estimator has none."""
        blocks = tuple(map(BlockPayload, *update.volatility))
        return cls(*(*values(blocks[0]), ALPHA_LEVELS, blocks)) if blocks else None


@record
class ForecastPayload:
    """The standing one-step forecast. The fields of the first output stand at the top; `outputs` has all of them."""

    sample_time: Time = shown("start of the last interval that was learned from")
    issue_time: Time = shown(examples=["2025-05-03T12:05:00Z"])
    valid_time: Time = shown("start of the interval that is forecast")
    period_s: float = shown("length of an interval, s")
    output: str = shown("channel of the network", examples=["T_air"])
    unit: Literal["degC"] = constant("degC", "unit of mean, median and interval bounds")
    mean: Number = shown("degC", examples=[21.34])
    median: Number = shown("degC", examples=[21.34])
    sd: Number = shown("standard deviation in K", examples=[0.052])
    intervals: tuple[Interval, ...]
    outputs: tuple[OutputForecast, ...]
    volatility: AlphaPayload | None = shown(_VOLATILITY)
    gate: Number = shown(_GATE)
    regime: str = shown(_REGIME)
    n_eff: Number = shown(_N_EFF)
    inputs: tuple[InputUsed, ...]
    quality: Quality = shown(_QUALITY)
    suspected: tuple[str, ...] = shown(_SUSPECTED)

    @classmethod
    def of(cls, update: Update, outputs: tuple[OutputForecast, ...] = ()) -> Self:
        """The forecast that `update` issued; `outputs` have other intervals than the published ones."""
        return cls(*_standing(update, outputs or update.forecast.outputs))


@record
class FanStepPayload:
    """One step of a forecast over several steps."""

    valid_time: Time
    outputs: tuple[OutputForecast, ...]


@record
class FanPayload(ForecastPayload):
    """The standing forecast and what follows it, one step per period."""

    horizon_s: float = shown("from valid_time to the last step, s")
    planned: tuple[str, ...] = shown("input channels whose planned values were used; the others are foreseen")
    origins: tuple[InputOrigin, ...] = shown("where the values of every input come from, after the first step")
    fan: tuple[FanStepPayload, ...] = shown("the first step is the standing one-step forecast")

    @classmethod
    def of_steps(cls, fan: Fan, planned: Iterable[str] = ()) -> Self:
        """All steps of `fan`; `planned` names the channels that followed a plan."""
        forecast, each = fan.update.forecast, steps(fan)
        period = forecast.valid_time - forecast.sample_time
        told = tuple(FanStepPayload(forecast.valid_time + k * period, step) for k, step in enumerate(each))
        horizon = (len(each) - 1) * period
        return cls(*(*_standing(fan.update, each[0]), horizon, tuple(planned), fan.origins, told))


@record
class AheadHorizonPayload:
    """The forecast of one time hours ahead."""

    lead: int = shown("from the last sample to the one that is forecast, s", key="lead_s")
    valid_time: Time
    mean: Number = shown("degC")
    sd: Number = shown("K")
    lower: Number = shown("degC")
    upper: Number = shown("degC")


@record
class AheadOutputPayload:
    """The hours ahead of one output."""

    output: str = shown("channel of the network", examples=["T_air"])
    unit: Literal["degC"] = constant("degC")
    horizons: tuple[AheadHorizonPayload, ...]
    mean: Vector = shown("from valid_time on, every step_s")
    lower: Vector
    upper: Vector

    @classmethod
    def of(cls, one: CompactOutputPayload, sample_time: int, period: float) -> Self:
        """The hours ahead of `one`, an output of a fan with a single level, of a zone with this `period` [s]."""
        columns = np.array([one.mean, one.sd, one.lower[0], one.upper[0]])
        counts = (round(horizon / period) for horizon in HORIZONS)
        # One step ahead is the published forecast itself.
        leads = {round(count * period): count - 1 for count in counts if 1 < count <= len(one.mean)}
        horizons = [AheadHorizonPayload(k, sample_time + k, *columns[:, at].tolist()) for k, at in leads.items()]
        return cls(one.output, tuple(horizons), *columns[[0, 2, 3], :: periods(AHEAD_STEP, period)])


@record
class NextHeatingPayload:
    """When to raise the set-point for the zone to be warm at the time at which it is likely to rise next."""

    target: Number = shown("degC")
    by: Moment
    probability: Number = shown("of being warm by then, 0 to 1")
    start: Moment | None = shown("latest time to raise the set-point; null: not even now is early enough")
    reached: Number = shown("probability of being warm by then with this start, or, without one, when starting now")


@record
class AheadPayload:
    """The next hours of a zone, inputs foreseen: some horizons, and a fan in steps of half an hour."""

    sample_time: Time = shown("start of the last interval that was learned from")
    issue_time: Time
    valid_time: Time = shown("of the first value of the fan")
    step_s: float = shown("from one value of the fan to the next, s")
    level: float = shown("probability content of lower to upper")
    quality: Quality = shown("as that of the published forecast; bad where a mean leaves the limits of its channel")
    suspected: tuple[str, ...] = shown(_SUSPECTED)
    outputs: tuple[AheadOutputPayload, ...]
    heating: NextHeatingPayload | None = shown(
        "null where no rise of the set-point is likely within a day, none is known before the present one ends, no law "
        "of the thermostat is known, the forecast is not trusted so far ahead, or no start is likely to suffice"
    )

    @classmethod
    def of(cls, fan: Fan, status: ZoneStatus, limits: Limits, heating: NextHeatingPayload | None = None) -> Self:
        """What `fan`, with a single level, says of the zone in `status`."""
        forecast = fan.update.forecast
        period = forecast.valid_time - forecast.sample_time
        means = ((one.output, mean) for one in fan.outputs for mean in one.mean.tolist())
        return cls(
            forecast.sample_time,
            forecast.issue_time,
            forecast.valid_time,
            periods(AHEAD_STEP, period) * period,
            fan.levels[0],
            quality(fan.update) if credible(status, means, limits) else Quality.BAD,
            suspected(status),
            tuple(AheadOutputPayload.of(one, forecast.sample_time, period) for one in fan.outputs),
            heating,
        )


def periods(seconds: float, period: float) -> int:
    """How many periods [s] stand for `seconds` of a zone with this period."""
    return max(1, round(seconds / (period if period >= SHORT_PERIOD else USUAL_PERIOD)))


@record
class VolatilityPayload:
    """The volatility after a sample."""

    sample_time: Time
    issue_time: Time
    volatility: AlphaPayload | None = shown(_VOLATILITY)

    @classmethod
    def of(cls, update: Update) -> Self:
        """The volatility in `update`."""
        return cls(update.time, update.forecast.issue_time, AlphaPayload.of(update))


@record
class GatePayload:
    """The learning gate after a sample, and the state of the filter."""

    sample_time: Time
    issue_time: Time
    gate: Number = shown(_GATE)
    unit: Literal["1"] = constant("1")
    regime: str = shown(_REGIME)
    n_eff: Number = shown(_N_EFF)
    resampled: bool
    floored: bool = shown("true if the parameter covariance had collapsed and was held at its floor")
    log_likelihood: Number = shown("log p(y_k | y_1:k-1); null when nothing was assimilated")

    @classmethod
    def of(cls, update: Update) -> Self:
        """The learning gate in `update`."""
        value, regime = update.shown_gate
        seen = update.shown_sample_size, update.resampled
        return cls(update.time, update.forecast.issue_time, value, regime, *seen, update.floored, update.log_likelihood)


@record
class NoisePayload:
    """How noisy one measured temperature is."""

    output: str = shown("channel of the network")
    unit: Literal["K"] = constant("K")
    lower: Number = shown("quantile of sigma_y at levels[0], K")
    median: Number = shown("median of sigma_y, K")
    upper: Number = shown("quantile of sigma_y at levels[2], K")


@record
class GainPayload:
    """What the estimator knows of what nobody measures: heat into the first measured node, and the sensors' noise."""

    sample_time: Time
    issue_time: Time
    unit: Literal["W"] = constant("W", "unit of lower, median and upper")
    levels: tuple[float, ...] = shown(_LEVELS)
    lower: Number = shown("W; null for an estimator without a model of the gain")
    median: Number = shown("W; a negative gain is a loss, such as an open window")
    upper: Number = shown("W")
    probability_on: Number = shown("probability that there is such heat now, 0 to 1")
    measurement_sd: tuple[NoisePayload, ...]

    @classmethod
    def of(cls, update: Update) -> Self | None:
        """What `update` knows of what nobody measures; None where the estimator has no model of it."""
        known, forecast = update.disturbance, update.forecast
        if known is None:
            return None
        noise = zip(forecast.outputs, known.measurement_sd, strict=True)
        noises = tuple(NoisePayload(one.output, *quantiles) for one, quantiles in noise)
        return cls(update.time, forecast.issue_time, ALPHA_LEVELS, *known.gain, known.probability_on, noises)


@record
class ChannelStatus:
    """When a channel last had a good reading."""

    channel: str
    last_good: Moment | None = shown("null: never since the start")
    age_s: Number = shown("age of last_good on the zone's clock, s")
    stale: bool = shown("true if the last interval brought no good reading of it")
    writer: str | None = shown("the source, or the key that posted the newest reading; null: none since the start")

    @classmethod
    def of(cls, channel: str, status: ZoneStatus) -> Self:
        """The last good reading of `channel` of the zone with `status`."""
        when, last, writer = status.last_good.get(channel), status.last_sample_time, status.writers.get(channel)
        if when is None:
            return cls(channel, None, _NONE, stale=True, writer=writer)
        # Readings that were good since the last sample are not in a sample yet.
        return cls(channel, when, clock(status) - when, last is not None and when < last, writer)


@record
class StatusPayload:
    """How a zone is doing."""

    state: str = shown("waiting, running, stalled or failed")
    reason: str = shown("one sentence; empty while running")
    last_sample_time: Time | None = shown("start of the newest interval")
    age_s: Number = shown("age of last_sample_time on the zone's clock, s")
    samples: int
    segment: int = shown("counts up at every gap longer than max_gap")
    outcome: str | None = shown("what became of the last sample: started, assimilated, missing or vanished")
    delay_s: float | None = shown("from the newest sample to the publication of its forecast")
    overruns: int = shown("forecasts since the start that came after the next sample was due")
    faults: Mapping[str, int] = shown("bad readings by kind since the start")
    channels: tuple[ChannelStatus, ...]
    findings: tuple[Finding, ...] = shown("what the zone's model does not know")

    @classmethod
    def of(cls, status: ZoneStatus, update: Update | None) -> Self:
        """How the zone with `status` is doing, with what became of its last sample, `update`."""
        last = status.last_sample_time
        return cls(
            status.state,
            status.reason,
            last,
            _NONE if last is None else clock(status) - last,
            status.samples,
            status.segment,
            None if update is None else update.outcome,
            status.delay,
            status.overruns,
            status.faults,
            tuple(ChannelStatus.of(channel, status) for channel in status.channels),
            status.diagnosis.findings,
        )


_NONE = float("nan")
Forecasted = TypeVar("Forecasted", bound=ForecastPayload)


def vouched(payload: Forecasted, status: ZoneStatus, limits: Limits = NO_LIMITS) -> Forecasted:
    """`payload` with what is suspected of the zone's telemetry, marked bad if the zone, which is in `status`, can no
    longer vouch for it, or if a mean of a fan leaves the `limits` of its channel."""
    payload = replace(payload, suspected=suspected(status))
    steps = payload.fan if isinstance(payload, FanPayload) else ()
    means = ((output.output, output.mean) for step in steps for output in step.outputs)
    return payload if credible(status, means, limits) else replace(payload, quality=Quality.BAD)


def credible(status: ZoneStatus, means: Iterable[tuple[str, float]], limits: Limits) -> bool:
    """Whether a zone in `status` vouches for its forecasts, and every mean of an output, by its name, lies where a
    measurement of it would be believed."""
    ranges = ((limits.get(output, default_valid_range("degC")), mean) for output, mean in means)
    return status.state not in ("stalled", "failed") and all(lower <= mean <= upper for (lower, upper), mean in ranges)


def suspected(status: ZoneStatus) -> tuple[str, ...]:
    """The findings about the telemetry of a zone in `status`."""
    return tuple(one.finding for one in status.diagnosis.findings if one.finding in TELEMETRY)


def clock(status: ZoneStatus) -> float:
    """The time that ages in `status` count from, UTC seconds."""
    return time.time() if status.now is None else status.now


def quality(update: Update) -> Quality:
    """The worst of the inputs' quality and what became of the last sample: missing is uncertain, vanished is bad."""
    inputs = update.forecast.inputs
    found = [_OUTCOME_QUALITY.get(update.outcome, Quality.GOOD), *(used.quality for used in inputs)]
    found += [Quality.UNCERTAIN for used in inputs if used.held]
    return max(found, key=_WORST_LAST.index)


def _standing(update: Update, outputs: tuple[OutputForecast, ...]) -> tuple[Any, ...]:
    """The fields of a ForecastPayload, in their order."""
    forecast, first = update.forecast, outputs[0]
    times = (update.time, forecast.issue_time, forecast.valid_time, forecast.valid_time - forecast.sample_time)
    top = (first.output, first.mean, first.median, first.sd, first.intervals, outputs)
    filtered = (AlphaPayload.of(update), *update.shown_gate, update.shown_sample_size)
    return (*times, *top, *filtered, forecast.inputs, quality(update), ())


def steps(fan: Fan) -> list[tuple[OutputForecast, ...]]:
    """The forecast of every output, step by step."""
    each = []
    for one in fan.outputs:
        bounds = zip(one.lower.T.tolist(), one.upper.T.tolist(), strict=True)
        intervals = [tuple(map(Interval, fan.levels, lower, upper)) for lower, upper in bounds]
        numbers = (one.mean.tolist(), one.median.tolist(), one.sd.tolist(), intervals)
        each.append([OutputForecast(one.output, *step) for step in zip(*numbers, strict=True)])
    return list(zip(*each, strict=True))


def at_levels(update: Update, levels: Sequence[float]) -> tuple[OutputForecast, ...]:
    """The published forecast of every output, with some of its intervals, in the order of `levels`."""
    return tuple(
        replace(one, intervals=tuple(i for level in levels for i in one.intervals if i.level == level))
        for one in update.forecast.outputs
    )
