"""Updates, statuses and fans as payloads."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
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
    FindingPayload,
    ForecastPayload,
    GainPayload,
    GatePayload,
    HorizonSkillPayload,
    HorizonTrustPayload,
    InputPayload,
    IntervalPayload,
    MemberPayload,
    NoisePayload,
    OriginPayload,
    OutputPayload,
    SkillPayload,
    SkillWindowPayload,
    StatusPayload,
    TrustPayload,
    VolatilityPayload,
)
from service.records.fan import Fan
from service.records.outlook import InputOrigin
from service.records.skill import HorizonSkill, Skill
from service.records.status import ZoneStatus
from service.records.trust import Trust
from service.records.update import InputUsed, OutputForecast, Update

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
    """The standing forecast of `fan`, with the intervals that were asked for."""
    return _forecast(site, zone, fan.update, fan.steps[0].outputs, fan.inputs)


def fan_payload(site: str, zone: str, fan: Fan, planned: Iterable[str] = ()) -> FanPayload:
    """All steps of `fan`; `planned` names the channels that followed a plan."""
    first, last = fan.steps[0].valid_time, fan.steps[-1].valid_time
    return FanPayload(
        **dict(refined_payload(site, zone, fan)),
        horizon_s=last - first,
        planned=list(planned),
        origins=[origin_payload(one) for one in fan.origins],
        fan=[
            FanStepPayload(valid_time=utc(step.valid_time), outputs=[_output(output) for output in step.outputs])
            for step in fan.steps
        ],
    )


def origin_payload(one: InputOrigin) -> OriginPayload:
    """Where the values of an input come from."""
    return OriginPayload(channel=one.channel, origin=one.origin, source=one.source, age_s=one.age, quality=one.quality)


def trust_payload(site: str, zone: str, trust: Trust) -> TrustPayload:
    """How far the zone's forecasts can be relied on."""
    return TrustPayload(
        site=site,
        zone=zone,
        sample_time=utc(trust.time),
        disturbed=trust.disturbed,
        horizons=[
            HorizonTrustPayload(lead_s=one.lead, trust=one.level, reason=one.reason, since=utc(one.since))
            for one in trust.horizons
        ],
    )


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


def skill_payload(site: str, zone: str, skill: Skill) -> SkillPayload:
    """What a zone's forecasts were worth."""
    return SkillPayload(
        site=site,
        zone=zone,
        sample_time=utc(skill.time),
        level=skill.level,
        windows=[
            SkillWindowPayload(days=days, horizons=[_horizon(one) for one in horizons])
            for days, horizons in skill.windows.items()
        ],
        members=[MemberPayload(member=name, weights=list(weights)) for name, weights in skill.weights.items()],
    )


def _horizon(one: HorizonSkill) -> HorizonSkillPayload:
    return HorizonSkillPayload(
        lead_s=one.lead,
        forecasts=one.forecasts,
        coverage=one.coverage,
        crps=one.crps,
        rmse=one.rmse,
        width=one.width,
        persistence_rmse=one.persistence_rmse,
        arx_rmse=one.arx_rmse,
        skill_against_persistence=one.against_persistence,
        skill_against_arx=one.against_arx,
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
        findings=finding_payloads(status),
    )


def finding_payloads(status: ZoneStatus) -> list[FindingPayload]:
    """The findings about the zone that is in `status`."""
    return [FindingPayload(**finding._asdict()) for finding in status.diagnosis.findings]


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
    described = [_output(output) for output in outputs]
    inputs = tuple(inputs)
    return ForecastPayload(
        site=site,
        zone=zone,
        sample_time=utc(update.time),
        issue_time=utc(forecast.issue_time),
        valid_time=utc(forecast.valid_time),
        period_s=forecast.valid_time - forecast.sample_time,
        **dict(described[0]),
        outputs=described,
        volatility=_alpha(update),
        gate=update.shown_gate.value,
        regime=update.shown_gate.regime,
        n_eff=update.shown_sample_size,
        inputs=[
            InputPayload(
                channel=used.channel,
                value=used.value,
                unit=used.unit,
                age_s=used.age,
                quality=used.quality,
                held=used.held,
            )
            for used in inputs
        ],
        quality=quality(update, inputs),
    )


def _narrowed(output: OutputForecast, levels: Sequence[float]) -> OutputForecast:
    at = {interval.level: interval for interval in output.intervals}
    return output._replace(intervals=tuple(at[level] for level in levels))


def _output(output: OutputForecast) -> OutputPayload:
    return OutputPayload(
        output=output.output,
        mean=output.mean,
        median=output.median,
        sd=output.sd,
        intervals=[IntervalPayload(level=i.level, lower=i.lower, upper=i.upper) for i in output.intervals],
    )


def _alpha(update: Update) -> AlphaPayload | None:
    volatility = update.volatility
    blocks = [
        BlockPayload(block=block, lower=lower, median=median, upper=upper, cdf=cdf)
        for block, lower, median, upper, cdf in zip(*volatility, strict=True)
    ]
    if not blocks:
        return None
    return AlphaPayload(**dict(blocks[0]), levels=list(ALPHA_LEVELS), blocks=blocks)
