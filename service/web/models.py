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
    WithJsonSchema,
)

from estimator.diagnosis.finding import Finding, VariantWeight
from service.fields.durations import parse_duration
from service.fields.numbers import is_level
from service.fields.times import ZoneMissing, parse_time
from service.publish.payloads import Envelope, Number, Payload, StatusPayload

MAX_LEVELS = 32
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


class TermPayload(Payload):
    """Posterior quantiles of the coefficient of one term of known heat, at the levels of the document."""

    name: str = Field(description="such as sun_south, sun_12, habit_06 or habit_weekend_06")
    node: str = Field(description="the node that it heats")
    unit: str = Field(description="m2 for an aperture, W for a habit")
    quantiles: list[Number]


class ParametersPayload(Envelope):
    """Posterior quantiles of the parameters and of what follows from them."""

    network: str
    levels: list[float]
    parameters: list[QuantilesPayload]
    time_constants: list[QuantilesPayload] = Field(description="in h, fastest first")
    heat_loss: QuantilesPayload = Field(
        description="heat-loss coefficient in W/K from the first measured node to all boundaries, steady state"
    )
    known_heat: list[TermPayload] = Field(
        description="sun and habits: apertures by facade or hour, the daily profile in W and what days off differ by; "
        "empty where the zone knows none"
    )
    variants: tuple[VariantWeight, ...] = Field(
        description="variants of the network in a bank, largest weight first; empty where all members have the same one"
    )
    findings: tuple[Finding, ...] = Field(description="what the zone's model does not know")


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
