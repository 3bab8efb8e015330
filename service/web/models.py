"""What REST takes in, and the payloads that only REST has."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    WithJsonSchema,
    WrapValidator,
)
from pydantic_core.core_schema import ValidatorFunctionWrapHandler

from service.fields.durations import parse_duration
from service.fields.numbers import is_level
from service.fields.times import ZoneMissing, parse_time
from service.publish.payloads import Envelope, FindingPayload, Number, Payload, StatusPayload

MAX_LEVELS = 32
MAX_INPUTS = 64
MAX_STEPS = 2016
"""A week of 5 min steps."""

MAX_ROWS = 20_000
PARAMETER_LEVELS = (0.025, 0.5, 0.975)


def _level(value: float) -> float:
    if not is_level(value):
        raise ValueError(f"a level lies between 0 and 1, such as 0.95, not {value:g}")
    return value


def _distinct(levels: list[float]) -> list[float]:
    return list(dict.fromkeys(levels))


def _instant(value: object) -> datetime:
    text = str(value)
    try:
        return parse_time(text)
    except ZoneMissing:
        raise ValueError(
            f"'{text}' has no time zone; end it with Z for UTC or with an offset such as %2B02:00"
        ) from None
    except ValueError:
        # A plus sign in a query string means a space.
        hint = "; write + as %2B in a query" if " " in text else ""
        raise ValueError(f"'{text}' is not an RFC 3339 time such as 2025-05-03T12:00:00Z{hint}") from None


def _values(value: object, read: ValidatorFunctionWrapHandler) -> object:
    # Both arms of the union would complain; one sentence per mistake is enough.
    if isinstance(value, list) and len(value) > MAX_STEPS:
        raise ValueError(f"give at most {MAX_STEPS} numbers, not {len(value)}")
    try:
        return read(value)
    except ValidationError:
        raise ValueError("give a finite number, or a list of finite numbers, in the network's unit") from None


Level = Annotated[
    float,
    AfterValidator(_level),
    WithJsonSchema({"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1, "examples": [0.95]}),
]
Levels = Annotated[list[Level], Field(max_length=MAX_LEVELS), AfterValidator(_distinct)]
Horizon = Annotated[
    float,
    BeforeValidator(parse_duration),
    WithJsonSchema(
        {"type": "string", "pattern": r"^\s*\d+(\.\d+)?(e[+-]?\d+)?\s*(s|min|h|d)\s*$", "examples": ["6h", "30min"]}
    ),
]
Instant = Annotated[datetime, BeforeValidator(_instant), WithJsonSchema({"type": "string", "format": "date-time"})]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Planned = Annotated[Finite | Annotated[list[Finite], Field(max_length=MAX_STEPS)], WrapValidator(_values)]


class Query(BaseModel):
    """Base of the query strings: a misspelt parameter is refused, not ignored."""

    model_config = ConfigDict(extra="forbid")


class ForecastQuery(Query):
    """Query of GET /zones/{zone}/forecast."""

    level: Levels = Field(
        default_factory=list,
        description="probability content of a prediction interval, between 0 and 1; may be repeated",
        examples=[[0.5, 0.95]],
    )
    horizon: Horizon | None = Field(default=None, description="how far beyond valid_time to forecast, inputs foreseen")


class ParametersQuery(Query):
    """Query of GET /zones/{zone}/parameters."""

    level: Levels = Field(
        default_factory=lambda: list(PARAMETER_LEVELS),
        description="quantile level, between 0 and 1; may be repeated",
    )


class ZonesQuery(Query):
    """Query of GET /zones."""

    limit: int | None = Field(default=None, ge=1, le=MAX_ROWS, description="zones at most; without, all of them")
    after: str | None = Field(
        default=None, max_length=64, description="the zone that the last page ended with, as `next` told it"
    )


class HistoryQuery(Query):
    """Query of GET /zones/{zone}/history."""

    start: Instant | None = Field(default=None, description="first time, RFC 3339 with zone, included")
    end: Instant | None = Field(default=None, description="last time, RFC 3339 with zone, excluded")
    limit: int = Field(default=1000, ge=1, le=MAX_ROWS, description="the newest rows are given")


class ReadingsQuery(Query):
    """Query of the routes that take readings."""

    precision: Literal["ns", "us", "ms", "s"] = Field(
        default="ns", description="line protocol: what the time stamps count"
    )


class PostedReading(BaseModel):
    """One reading in a JSON body."""

    model_config = ConfigDict(extra="forbid", strict=True)

    channel: Annotated[str, Field(min_length=1, max_length=256)] = Field(
        description="zone/channel, or the name that the configuration gives it; for one zone the channel is enough"
    )
    value: Finite | None = Field(description="null: the device has no value")
    time: Instant | None = Field(default=None, description="RFC 3339 with zone; null: now")
    unit: str | None = Field(default=None, description="if given, it must be the unit of the channel")
    quality: Literal["good", "uncertain", "bad"] = "good"


class PostedReadings(BaseModel):
    """Body of POST /readings and POST /zones/{zone}/readings in JSON."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [{"readings": [{"channel": "office/T_i", "value": 21.5, "time": "2026-01-15T12:00:00Z"}]}]
        },
    )

    readings: list[PostedReading]


class ReadingsPayload(Payload):
    """What became of posted readings; those that are accepted are on disk."""

    schema_version: Literal[1] = Field(default=1, alias="schema")
    site: str
    accepted: int = Field(description="in the journal; they will be in the samples of their intervals")
    repeated: int = Field(description="accepted before: the same channel and time")
    first_counts: int = Field(description="counts of counters from which there is no power yet")
    refused: dict[str, int] = Field(description="by fault; they are also counted in the status of the zone")
    unknown: int = Field(description="values that no channel asks for")
    unknown_names: list[str] = Field(description="what some of these are called")


class ForecastRequest(BaseModel):
    """Body of POST /zones/{zone}/forecast: a forecast under planned inputs."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        json_schema_extra={
            "examples": [{"horizon": "1h", "levels": [0.5, 0.95], "inputs": {"u_heat": 2000.0, "T_out": 5.5}}]
        },
    )

    horizon: Horizon = Field(description="how far beyond valid_time to forecast; a whole number of periods")
    levels: Levels = Field(default_factory=list, description="levels of the intervals; default: the published ones")
    inputs: dict[str, Planned] = Field(
        default_factory=dict,
        max_length=MAX_INPUTS,
        description=(
            "planned values per input channel, in the network's unit: one number for the whole horizon or one per "
            "step, of which the first holds from valid_time to valid_time + period_s; channels not named are foreseen"
        ),
    )


class ChannelPayload(Payload):
    """A channel that the zone's network needs."""

    channel: str
    unit: str
    role: Literal["output", "input"]


class PriorPayload(Payload):
    """A parameter of the network and the box of its log-uniform prior."""

    name: str
    unit: str
    free: bool = Field(description="false: held at nominal")
    lower: Number = Field(description="in unit")
    upper: Number = Field(description="in unit")
    nominal: Number = Field(description="in unit")


class ZoneSummary(Payload):
    """A zone in the list of zones."""

    id: str
    network: str
    estimator: str
    period_s: float
    outputs: list[str]
    state: str = Field(description="waiting, running, stalled or failed")
    reason: str
    samples: int
    last_sample_time: AwareDatetime | None


class ZonesPayload(Payload):
    """Every zone of the site."""

    schema_version: Literal[1] = Field(default=1, alias="schema")
    site: str
    zones: list[ZoneSummary]
    next: str | None = Field(default=None, description="`after` of the next page; null where there is none")


class ZonePayload(Envelope):
    """One zone: what it consists of and how it is doing."""

    network: str
    description: str
    estimator: str
    period_s: float
    channels: list[ChannelPayload]
    parameters: list[PriorPayload]
    status: StatusPayload


class QuantilesPayload(Payload):
    """Posterior quantiles of one quantity, at the levels of the document."""

    name: str
    unit: str
    free: bool = Field(description="false: held, so that all quantiles are the same")
    quantiles: list[Number]


class VariantPayload(Payload):
    """A variant of the zone's network among the members of a bank."""

    variant: str = Field(description="own: the zone's network as it is")
    weight: float = Field(description="share of the forecast 6 h ahead that its members carry, 0 to 1")


class ParametersPayload(Envelope):
    """Posterior quantiles of the parameters and of what follows from them."""

    network: str
    levels: list[float]
    parameters: list[QuantilesPayload]
    time_constants: list[QuantilesPayload] = Field(description="in h, fastest first")
    heat_loss: QuantilesPayload = Field(
        description="heat-loss coefficient in W/K from the first measured node to all boundaries, steady state"
    )
    variants: list[VariantPayload] = Field(
        description="variants of the network in a bank, largest weight first; empty where all members have the same one"
    )
    findings: list[FindingPayload] = Field(description="what the zone's model does not know")


class HistoryRowPayload(Payload):
    """One sample against the forecast that stood before it was seen."""

    time: AwareDatetime
    y: Number = Field(description="measured, degC")
    mean: Number = Field(description="degC")
    lower: Number = Field(description="degC, at the first published level")
    upper: Number = Field(description="degC, at the first published level")
    sd: Number = Field(description="K")
    residual: Number = Field(description="y - mean, K")
    alpha_lower: Number = Field(description=".025 quantile")
    alpha_median: Number
    alpha_upper: Number = Field(description=".975 quantile")
    cdf: Number
    gate: Number
    n_eff: Number
    resampled: bool
    log_likelihood: Number
    segment: int
    gain_lower: Number = Field(description="unmeasured heat, .025 quantile, W; null where the estimator knows of none")
    gain_median: Number = Field(description="W")
    gain_upper: Number = Field(description=".975 quantile, W")
    setpoint: Number = Field(description="set-point, degC; null where none was told")


class HistoryPayload(Envelope):
    """Samples in time order, for the first output."""

    output: str
    unit: Literal["degC"] = "degC"
    period_s: float
    rows: list[HistoryRowPayload]


class HealthPayload(Payload):
    """The process is alive."""

    status: Literal["ok"] = "ok"
    version: str
    uptime_s: float


class ZoneReadiness(Payload):
    """Whether a zone is fed and fresh."""

    id: str
    state: str = Field(description="waiting, running, stalled or failed; only running is ready")
    reason: str
    period_s: float
    age_s: float | None = Field(
        description="how long ago the interval of the last sample began; null before the first. At most about two "
        "periods where all is well"
    )
    channels: dict[str, float | None] = Field(
        description="age in s of each channel's last good reading; null if it never had one"
    )


class ReadyPayload(Payload):
    """Every zone is fed and fresh."""

    status: Literal["ready"] = "ready"
    zones: list[ZoneReadiness] = Field(description="the first 20; GET /zones lists all")
    zone_count: int = Field(description="how many zones there are")


class ReloadPayload(Payload):
    """The configuration was read again and is in force."""

    status: Literal["reloaded"] = "reloaded"
    done: str = Field(description="what was added, changed and removed, as in the log")
