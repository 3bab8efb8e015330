"""What REST takes in, and the payloads that only REST has."""

import json
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, Field, WithJsonSchema

from adapters.fields.durations import parse_duration
from adapters.fields.numbers import is_level
from adapters.fields.times import ZoneMissing, parse_time
from estimator.diagnosis.finding import Finding, VariantWeight
from service.forecast.answers import LearnedLaw
from service.publish.payloads import StatusPayload
from service.records.record import Time, Vector, constant, document_of, record, shown

if TYPE_CHECKING:
    StatusDocument = StatusPayload
else:
    StatusDocument = document_of(StatusPayload)

EXAMPLES = json.loads(Path(__file__).with_name("examples.json").read_text(encoding="utf-8"))
"""Documents of the OpenAPI description, by what they are of."""
MAX_LEVELS = 32


def _level(value: float) -> float:
    if not is_level(value):
        raise ValueError(f"a level lies between 0 and 1, such as 0.95, not {value:g}")
    return value


def _instant(value: object) -> datetime:
    text = str(value)
    try:
        return parse_time(text)
    except ZoneMissing:
        raise ValueError(
            f"'{text}' has no time zone; end it with Z for UTC or with an offset such as +02:00 (in a query %2B02:00)"
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
Levels = Annotated[
    list[Level], Field(max_length=MAX_LEVELS), AfterValidator(lambda levels: list(dict.fromkeys(levels)))
]
Horizon = Annotated[
    float,
    BeforeValidator(parse_duration),
    WithJsonSchema(
        {"type": "string", "pattern": r"^\s*\d+(\.\d+)?(e[+-]?\d+)?\s*(s|min|h|d)\s*$", "examples": ["6h", "30min"]}
    ),
]
Instant = Annotated[datetime, BeforeValidator(_instant), WithJsonSchema({"type": "string", "format": "date-time"})]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class PostedReading(BaseModel, extra="forbid", strict=True):
    """One reading in a JSON body."""

    channel: Annotated[str, Field(min_length=1, max_length=256)] = Field(
        description="zone/channel, or the name that the configuration gives it; for one zone the channel is enough"
    )
    value: Finite | None = Field(description="null: the device has no value")
    time: Instant | None = Field(default=None, description="RFC 3339 with zone; null: now")
    unit: str | None = Field(default=None, description="if given, it must be the unit of the channel")
    quality: Literal["good", "uncertain", "bad"] = "good"


class PostedReadings(BaseModel, extra="forbid", json_schema_extra={"examples": EXAMPLES["PostedReadings"]}):
    """Body of POST /readings and POST /zones/{zone}/readings in JSON."""

    readings: list[PostedReading]


@record
class ChannelPayload:
    """A channel that the zone's network needs."""

    channel: str
    unit: str
    role: Literal["output", "input"]


@record
class PriorPayload:
    """A parameter of the network and the box of its log-uniform prior."""

    name: str
    unit: str
    free: bool = shown("false: held at nominal")
    lower: float | None = shown("in unit")
    upper: float | None = shown("in unit")
    nominal: float | None = shown("in unit")


@record
class ZoneSummary:
    """A zone in the list of zones."""

    id: str
    network: str
    estimator: str
    period_s: float
    outputs: tuple[str, ...]
    state: str = shown("waiting, running, stalled or failed")
    reason: str
    samples: int
    last_sample_time: Time | None


@record
class ZonesPayload:
    """Every zone of the site."""

    zones: tuple[ZoneSummary, ...]
    next: str | None = shown("`after` of the next page; null where there is none")


@record
class ZonePayload:
    """One zone: what it consists of and how it is doing."""

    network: str
    description: str
    estimator: str
    period_s: float
    channels: tuple[ChannelPayload, ...]
    parameters: tuple[PriorPayload, ...]
    status: StatusDocument


@record
class QuantilesPayload:
    """Posterior quantiles of one quantity, at the levels of the document."""

    name: str
    unit: str
    free: bool = shown("false: held, so that all quantiles are the same")
    quantiles: Vector
    collapsed: bool = shown(
        "true: the interval of a parameter is narrower than telemetry can make it, so that none is believed; "
        "quantiles but the median are null"
    )


@record
class TermPayload:
    """Posterior quantiles of the coefficient of one term of known heat, at the levels of the document."""

    name: str = shown("such as sun_south, sun_12, habit_06 or habit_weekend_06")
    node: str = shown("the node that it heats")
    unit: str = shown("m2 for an aperture, W for a habit")
    quantiles: Vector


@record
class ParametersPayload:
    """Posterior quantiles of the parameters and of what follows from them."""

    network: str
    levels: tuple[float, ...]
    parameters: tuple[QuantilesPayload, ...]
    time_constants: tuple[QuantilesPayload, ...] = shown("in h, fastest first")
    heat_loss: QuantilesPayload = shown(
        "heat-loss coefficient in W/K from the first measured node to all boundaries, steady state"
    )
    known_heat: tuple[TermPayload, ...] = shown(
        "sun and habits: apertures by facade or hour, the daily profile in W and what days off differ by; "
        "empty where the zone knows none"
    )
    thermostat: tuple[LearnedLaw, ...] = shown(
        "the law of the thermostat by heat input, each number with its 95 % interval; empty where none is known"
    )
    variants: tuple[VariantWeight, ...] = shown(
        "variants of the network in a bank, largest weight first; empty where all members have the same one"
    )
    findings: tuple[Finding, ...] = shown("what the zone's model does not know")


@record
class HealthPayload:
    """The process is alive."""

    status: Literal["ok"] = constant("ok")
    version: str | None = shown("null without a key where keys are in force")
    uptime_s: float


@record
class ZoneReadiness:
    """Whether a zone is fed and fresh."""

    id: str
    state: str = shown("waiting, running, stalled or failed; only running is ready")
    reason: str
    period_s: float
    age_s: float | None = shown(
        "how long ago the interval of the last sample began; null before the first. At most about two "
        "periods where all is well"
    )
    channels: Mapping[str, float | None] = shown(
        "age in s of each channel's last good reading; null if it never had one"
    )


@record
class ReadyPayload:
    """Every zone is fed and fresh."""

    status: Literal["ready"] = constant("ready")
    zones: tuple[ZoneReadiness, ...] = shown("the first 20; GET /zones lists all")
    zone_count: int = shown("how many zones there are")


@record
class ReloadPayload:
    """The configuration was read again and is in force."""

    status: Literal["reloaded"] = constant("reloaded")
    done: str = shown("what was added, changed and removed, as in the log")
