"""Updates, statuses and fans as payloads."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from adapters.reading import Quality
from adapters.units import default_valid_range
from estimator.types import ALPHA_LEVELS, Outcome
from service.fields.times import utc
from service.publish.payloads import (
    AlphaPayload,
    BlockPayload,
    ChannelStatus,
    FanPayload,
    FanStepPayload,
    ForecastPayload,
    GainPayload,
    GatePayload,
    NoisePayload,
    StatusPayload,
    VolatilityPayload,
)
from service.records.fan import Fan
from service.records.status import ZoneStatus
from service.records.update import InputUsed, Interval, OutputForecast, Update

_WORST_LAST = (Quality.GOOD, Quality.UNCERTAIN, Quality.BAD)
Forecasted = TypeVar("Forecasted", bound=ForecastPayload)
Limits = Mapping[str, tuple[float, float]]
NO_LIMITS: Limits = {}

_OUTCOME_QUALITY: Mapping[str, Quality] = {Outcome.MISSING: Quality.UNCERTAIN, Outcome.VANISHED: Quality.BAD}


def forecast_payload(site: str, zone: str, update: Update, levels: Sequence[float] | None = None) -> ForecastPayload:
    """The forecast that `update` issued; `levels` picks some of its intervals, in that order (None: all)."""
    forecast = update.forecast
    outputs = forecast.outputs if levels is None else tuple(_narrowed(output, levels) for output in forecast.outputs)
    return _forecast(site, zone, update, outputs, forecast.inputs)


def vouched(payload: Forecasted, status: ZoneStatus, limits: Limits = NO_LIMITS) -> Forecasted:
    """`payload`, marked bad if the zone, which is in `status`, can no longer vouch for it, or if a mean of a fan leaves
    the `limits` of its channel."""
    steps = payload.fan if isinstance(payload, FanPayload) else []
    means = [(output.output, output.mean) for step in steps for output in step.outputs]
    if status.state in ("stalled", "failed") or not believable(means, limits):
        return payload.model_copy(update={"quality": Quality.BAD})
    return payload


def believable(means: Iterable[tuple[str, float | None]], limits: Limits) -> bool:
    """Whether every mean of an output, by its name, lies where a measurement of it would be believed."""
    for output, mean in means:
        lower, upper = limits.get(output, default_valid_range("degC"))
        if mean is None or not lower <= mean <= upper:
            return False
    return True


def refined_payload(site: str, zone: str, fan: Fan) -> ForecastPayload:
    """The published forecast of `fan`, with the intervals that were asked for."""
    update = fan.update
    return _forecast(site, zone, update, _steps(fan)[0], update.forecast.inputs)


def fan_payload(site: str, zone: str, fan: Fan, planned: Iterable[str] = ()) -> FanPayload:
    """All steps of `fan`; `planned` names the channels that followed a plan."""
    first, steps = fan.update.forecast.valid_time, _steps(fan)
    period = first - fan.update.forecast.sample_time
    return FanPayload(
        **dict(_forecast(site, zone, fan.update, steps[0], fan.update.forecast.inputs)),
        horizon_s=(len(steps) - 1) * period,
        planned=list(planned),
        origins=fan.origins,
        fan=[FanStepPayload(valid_time=utc(first + ahead * period), outputs=step) for ahead, step in enumerate(steps)],
    )


def _steps(fan: Fan) -> list[tuple[OutputForecast, ...]]:
    """The forecast of every output, step by step."""
    each = []
    for one in fan.outputs:
        bounds = zip(one.lower.T.tolist(), one.upper.T.tolist(), strict=True)
        intervals = [tuple(map(Interval, fan.levels, lower, upper)) for lower, upper in bounds]
        numbers = (one.mean.tolist(), one.median.tolist(), one.sd.tolist(), intervals)
        each.append([OutputForecast(one.output, *step) for step in zip(*numbers, strict=True)])
    return list(zip(*each, strict=True))


def volatility_payload(site: str, zone: str, update: Update) -> VolatilityPayload:
    """The volatility in `update`."""
    return VolatilityPayload(
        site=site,
        zone=zone,
        sample_time=utc(update.time),
        issue_time=utc(update.forecast.issue_time),
        volatility=_alpha(update),
    )


def gate_payload(site: str, zone: str, update: Update) -> GatePayload:
    """The learning gate in `update`."""
    return GatePayload(
        site=site,
        zone=zone,
        sample_time=utc(update.time),
        issue_time=utc(update.forecast.issue_time),
        gate=update.shown_gate.value,
        regime=update.shown_gate.regime,
        n_eff=update.shown_sample_size,
        resampled=update.resampled,
        floored=update.floored,
        log_likelihood=update.log_likelihood,
    )


def gain_payload(site: str, zone: str, update: Update) -> GainPayload | None:
    """What `update` knows of what nobody measures; None where the estimator has no model of it."""
    known = update.disturbance
    if known is None:
        return None
    lower, median, upper = known.gain
    return GainPayload(
        site=site,
        zone=zone,
        sample_time=utc(update.time),
        issue_time=utc(update.forecast.issue_time),
        levels=list(ALPHA_LEVELS),
        lower=lower,
        median=median,
        upper=upper,
        probability_on=known.probability_on,
        measurement_sd=[
            NoisePayload(output=forecast.output, lower=noise[0], median=noise[1], upper=noise[2])
            for forecast, noise in zip(update.forecast.outputs, known.measurement_sd, strict=True)
        ],
    )


def status_payload(site: str, zone: str, status: ZoneStatus, update: Update | None) -> StatusPayload:
    """How the zone is doing, with what became of its last sample."""
    now = clock(status)
    last = status.last_sample_time
    return StatusPayload(
        site=site,
        zone=zone,
        state=status.state,
        reason=status.reason,
        last_sample_time=None if last is None else utc(last),
        age_s=None if last is None else now - last,
        samples=status.samples,
        segment=status.segment,
        outcome=None if update is None else update.outcome,
        delay_s=status.delay,
        overruns=status.overruns,
        faults=dict(status.faults),
        channels=[_channel(channel, status, now) for channel in status.channels],
        findings=status.diagnosis.findings,
    )


def _channel(channel: str, status: ZoneStatus, now: float) -> ChannelStatus:
    when, last = status.last_good.get(channel), status.last_sample_time
    # Readings that were good since then are not in a sample yet.
    stale = when is None or (last is not None and when < last)
    age = None if when is None else now - when
    return ChannelStatus(channel=channel, last_good=None if when is None else utc(when), age_s=age, stale=stale)


def clock(status: ZoneStatus) -> float:
    """The time that ages in `status` count from, UTC seconds."""
    return time.time() if status.now is None else status.now


def quality(update: Update, inputs: Iterable[InputUsed]) -> Quality:
    """The worst of the inputs' quality and what became of the last sample: missing is uncertain, vanished is bad."""
    found = [_OUTCOME_QUALITY.get(update.outcome, Quality.GOOD)]
    found += [*(Quality.UNCERTAIN for used in inputs if used.held), *(used.quality for used in inputs)]
    return max(found, key=_WORST_LAST.index)


def _forecast(
    site: str,
    zone: str,
    update: Update,
    outputs: Iterable[OutputForecast],
    inputs: Iterable[InputUsed],
) -> ForecastPayload:
    forecast = update.forecast
    described, inputs = tuple(outputs), tuple(inputs)
    first = described[0]
    return ForecastPayload(
        site=site,
        zone=zone,
        sample_time=utc(update.time),
        issue_time=utc(forecast.issue_time),
        valid_time=utc(forecast.valid_time),
        period_s=forecast.valid_time - forecast.sample_time,
        output=first.output,
        mean=first.mean,
        median=first.median,
        sd=first.sd,
        intervals=first.intervals,
        outputs=described,
        volatility=_alpha(update),
        gate=update.shown_gate.value,
        regime=update.shown_gate.regime,
        n_eff=update.shown_sample_size,
        inputs=inputs,
        quality=quality(update, inputs),
    )


def _narrowed(output: OutputForecast, levels: Sequence[float]) -> OutputForecast:
    at = {interval.level: interval for interval in output.intervals}
    return replace(output, intervals=tuple(at[level] for level in levels))


def _alpha(update: Update) -> AlphaPayload | None:
    volatility = update.volatility
    blocks = [
        BlockPayload(block=block, lower=lower, median=median, upper=upper, cdf=cdf)
        for block, lower, median, upper, cdf in zip(*volatility, strict=True)
    ]
    if not blocks:
        return None
    return AlphaPayload(**dict(blocks[0]), levels=list(ALPHA_LEVELS), blocks=blocks)
