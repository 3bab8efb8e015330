"""What leaves the daemon, on Zenoh and REST alike: JSON with a schema version, units and RFC 3339 UTC times.

Numbers are written in full, so that reading one back gives the very same float64; what is not a finite number is null.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import AwareDatetime, BaseModel, BeforeValidator, ConfigDict, Field

from adapters.reading import Quality
from estimator.diagnosis.finding import Finding
from service.records.outlook import InputOrigin
from service.records.update import InputUsed, Interval, OutputForecast


def _finite(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


Number = Annotated[float | None, BeforeValidator(_finite)]
"""A float64, null where there is no finite value."""


class Payload(BaseModel):
    """Base of all payloads: fields go by the names they have in JSON, and none are added silently."""

    model_config = ConfigDict(populate_by_name=True, extra="forbid", frozen=True)


class Envelope(Payload):
    """What every payload of a zone begins with."""

    schema_version: Literal[1] = Field(default=1, alias="schema", description="version of this payload's schema")
    site: str = Field(examples=["htwg"])
    zone: str = Field(examples=["living"])


class BlockPayload(Payload):
    """Quantiles of the volatility alpha of one block, and where its median stands in its own history."""

    block: str
    lower: Number = Field(description="quantile of alpha at levels[0]; dimensionless")
    median: Number = Field(description="median of alpha; dimensionless")
    upper: Number = Field(description="quantile of alpha at levels[2]; dimensionless")
    cdf: Number = Field(description="F_k: share of past medians below the present one, 0 to 1")


class AlphaPayload(BlockPayload):
    """The volatility alpha: the first block, and all of them in `blocks`. 1 is the model's nominal process noise."""

    levels: list[float] = Field(description="levels of lower, median and upper")
    unit: Literal["1"] = "1"
    blocks: list[BlockPayload]


class FanStepPayload(Payload):
    """One step of a forecast over several steps."""

    valid_time: AwareDatetime
    outputs: tuple[OutputForecast, ...]


class ForecastPayload(Envelope):
    """The standing one-step forecast. The fields of the first output stand at the top; `outputs` has all of them."""

    sample_time: AwareDatetime = Field(description="start of the last interval that was learned from")
    issue_time: AwareDatetime = Field(examples=["2025-05-03T12:05:00Z"])
    valid_time: AwareDatetime = Field(description="start of the interval that is forecast")
    period_s: float = Field(description="length of an interval, s")
    output: str = Field(description="channel of the network", examples=["T_air"])
    unit: Literal["degC"] = Field(default="degC", description="unit of mean, median and interval bounds")
    mean: Number = Field(description="degC", examples=[21.34])
    median: Number = Field(description="degC", examples=[21.34])
    sd: Number = Field(description="standard deviation in K", examples=[0.052])
    intervals: tuple[Interval, ...]
    outputs: tuple[OutputForecast, ...]
    volatility: AlphaPayload | None = Field(description="null where the estimator has no volatility (ekf, ukf)")
    gate: Number = Field(description="learning gate g_k: how much the parameters may move now, 0 to 1")
    regime: str = Field(description="low, transitional or high volatility; constant where there is none")
    n_eff: Number = Field(description="effective sample size, particles; null where the estimator has none")
    inputs: tuple[InputUsed, ...]
    quality: Quality = Field(description="the worst of the inputs' quality and what became of the last sample")


class FanPayload(ForecastPayload):
    """The standing forecast and what follows it, one step per period."""

    horizon_s: float = Field(description="from valid_time to the last step, s")
    planned: list[str] = Field(description="input channels whose planned values were used; the others are foreseen")
    origins: tuple[InputOrigin, ...] = Field(
        description="where the values of every input come from, after the first step"
    )
    fan: list[FanStepPayload] = Field(description="the first step is the standing one-step forecast")


class VolatilityPayload(Envelope):
    """The volatility after a sample."""

    sample_time: AwareDatetime
    issue_time: AwareDatetime
    volatility: AlphaPayload | None = Field(description="null where the estimator has no volatility (ekf, ukf)")


class GatePayload(Envelope):
    """The learning gate after a sample, and the state of the filter."""

    sample_time: AwareDatetime
    issue_time: AwareDatetime
    gate: Number = Field(description="learning gate g_k: how much the parameters may move now, 0 to 1")
    unit: Literal["1"] = "1"
    regime: str = Field(description="low, transitional or high volatility; constant where there is none")
    n_eff: Number = Field(description="effective sample size, particles; null where the estimator has none")
    resampled: bool
    floored: bool = Field(description="true if the parameter covariance had collapsed and was held at its floor")
    log_likelihood: Number = Field(description="log p(y_k | y_1:k-1); null when nothing was assimilated")


class NoisePayload(Payload):
    """How noisy one measured temperature is."""

    output: str = Field(description="channel of the network")
    unit: Literal["K"] = "K"
    lower: Number = Field(description="quantile of sigma_y at levels[0], K")
    median: Number = Field(description="median of sigma_y, K")
    upper: Number = Field(description="quantile of sigma_y at levels[2], K")


class GainPayload(Envelope):
    """What the estimator knows of what nobody measures: heat into the first measured node, and the sensors' noise."""

    sample_time: AwareDatetime
    issue_time: AwareDatetime
    unit: Literal["W"] = Field(default="W", description="unit of lower, median and upper")
    levels: list[float] = Field(description="levels of lower, median and upper")
    lower: Number = Field(description="W; null for an estimator without a model of the gain")
    median: Number = Field(description="W; a negative gain is a loss, such as an open window")
    upper: Number = Field(description="W")
    probability_on: Number = Field(description="probability that there is such heat now, 0 to 1")
    measurement_sd: list[NoisePayload]


class ChannelStatus(Payload):
    """When a channel last had a good reading."""

    channel: str
    last_good: AwareDatetime | None = Field(description="null: never since the start")
    age_s: Number = Field(description="age of last_good on the zone's clock, s")
    stale: bool = Field(description="true if the last interval brought no good reading of it")


class StatusPayload(Envelope):
    """How a zone is doing."""

    state: str = Field(description="waiting, running, stalled or failed")
    reason: str = Field(description="one sentence; empty while running")
    last_sample_time: AwareDatetime | None = Field(description="start of the newest interval")
    age_s: Number = Field(description="age of last_sample_time on the zone's clock, s")
    samples: int
    segment: int = Field(description="counts up at every gap longer than max_gap")
    outcome: str | None = Field(description="what became of the last sample: started, assimilated, missing or vanished")
    delay_s: float | None = Field(description="from the newest sample to the publication of its forecast")
    overruns: int = Field(description="forecasts since the start that came after the next sample was due")
    faults: dict[str, int] = Field(description="bad readings by kind since the start")
    channels: list[ChannelStatus]
    findings: tuple[Finding, ...] = Field(description="what the zone's model does not know")


def to_json(payload: Payload) -> bytes:
    """Strict JSON, UTF-8."""
    return payload.model_dump_json(by_alias=True).encode()


def to_json_with(payload: Payload, items: Iterable[bytes]) -> bytes:
    """The same of `payload`, whose last field is an empty list, with `items` in it, each of them JSON: for lists that
    would take much memory, and the interpreter for long, in one piece."""
    return to_json(payload).removesuffix(b"]}") + b",".join(items) + b"]}"
