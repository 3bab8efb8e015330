"""What a controller sends, and the payloads that it gets."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field

from adapters.reading import Quality
from service.publish.payloads import Envelope, Number, Payload
from service.records.outlook import InputOrigin
from service.records.trust import HorizonTrust
from service.web.models import Horizon, Levels, Query
from service.web.planned import PlannedInput

MAX_DRAWS = 1000
MAX_PLANS = 64
MAX_ZONES = 500


class ModelQuery(Query):
    """Query of GET /zones/{zone}/model."""

    step: Horizon | None = Field(default=None, description="step of the matrices; default: the zone's period")
    draws: int = Field(default=100, ge=1, le=MAX_DRAWS, description="how many draws at most")


class SitePlan(BaseModel):
    """A plan for the site: the inputs of each zone."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(default="", max_length=64, description="comes back with the answer")
    inputs: dict[str, dict[str, PlannedInput]] = Field(
        default_factory=dict,
        max_length=MAX_ZONES + 1,
        description='by zone, then by input channel; the zone "*" stands for every zone that has the input',
    )


class SiteForecastRequest(BaseModel):
    """Body of POST /forecasts."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {
                    "horizon": "24h",
                    "zones": ["living"],
                    "levels": [0.9],
                    "scenarios": 0,
                    "plans": [
                        {"name": "off", "inputs": {"living": {"u_heat": 0.0}}},
                        {"name": "on", "inputs": {"living": {"u_heat": 2000.0}, "*": {"T_out": 5.0}}},
                    ],
                }
            ]
        },
    )

    horizon: Horizon = Field(description="how far beyond valid_time; a whole number of each zone's periods")
    zones: Annotated[list[str], Field(max_length=MAX_ZONES)] = Field(
        default_factory=list, description="ids; default: every zone"
    )
    levels: Levels = Field(default_factory=list, description="levels of the intervals; default: the published ones")
    scenarios: int = Field(default=0, ge=0, le=MAX_DRAWS, description="sampled futures of each zone and plan")
    plans: Annotated[list[SitePlan], Field(min_length=1, max_length=MAX_PLANS)] = Field(
        default_factory=lambda: [SitePlan()], description="default: one plan that plans nothing"
    )


class QuantityPayload(Payload):
    """A state, input or output, in the order of the matrices."""

    name: str
    unit: str


class MatricesPayload(Payload):
    """x' = A x + B u + w, w ~ N(0, Q); y = C x + v, v ~ N(0, R). An unmeasured gain is the last state."""

    A: list[list[Number]] = Field(description="(n_x, n_x); the last column is what the gain does, if there is one")
    B: list[list[Number]] = Field(description="(n_x, n_u)")
    C: list[list[Number]] = Field(description="(n_y, n_x)")
    Q: list[list[Number]] = Field(description="(n_x, n_x), K^2 and W^2 per step")
    R: list[list[Number]] = Field(description="(n_y, n_y), K^2")
    state: list[Number] = Field(description="(n_x,), degC and W, at valid_time")


class DrawsPayload(Payload):
    """K models: the same matrices with one more axis in front; C is the same for all."""

    weights: list[Number] = Field(description="they add up to 1")
    A: list[list[list[Number]]]
    B: list[list[list[Number]]]
    Q: list[list[list[Number]]]
    R: list[list[list[Number]]]
    state: list[list[Number]]


class GainForecastPayload(Payload):
    """The unmeasured gain at the beginning of each step of a day."""

    unit: Literal["W"] = "W"
    mean: list[Number]
    sd: list[Number] = Field(description="W; over the draws")


class ModelPayload(Envelope):
    """The linear model of a zone, at the step that was asked for."""

    sample_time: AwareDatetime
    issue_time: AwareDatetime
    valid_time: AwareDatetime = Field(description="the time of the state")
    period_s: float
    step_s: float
    network: str
    estimator: str
    member: str = Field(description="the member of a bank whose model this is; empty for other estimators")
    share: float = Field(description="what that member weighs in the bank's forecast a few hours ahead; otherwise 1")
    fan_mean: str = Field(description="what gives the mean of the fan (of the member) when simulated: mean or draws")
    states: list[QuantityPayload] = Field(description="temperatures, and then the unmeasured gain if there is one")
    inputs: list[QuantityPayload]
    outputs: list[QuantityPayload]
    mean: MatricesPayload = Field(description="at the posterior mean of the log parameters")
    covariance: list[list[Number]] = Field(description="of the state, K^2 and W^2")
    draws: DrawsPayload
    known_heat: list[list[Number]] = Field(
        description="what sun and habits add to each state over each step of a day, K, under inputs as foreseen "
        "without a plan: x' = A x + B u + this; empty where the zone knows neither"
    )
    gain: GainForecastPayload | None = Field(description="null for an estimator without a model of it")


class CompactOutputPayload(Payload):
    """The forecast of one output over all steps: arrays, the first entry of which is for valid_time."""

    output: str
    unit: Literal["degC"] = "degC"
    mean: list[Number]
    median: list[Number]
    sd: list[Number] = Field(description="K, the sensor's noise included")
    lower: list[list[Number]] = Field(description="by level and then by step")
    upper: list[list[Number]]
    scenarios: list[list[Number]] = Field(description="sampled futures, without the sensor's noise")


class ZoneForecastPayload(Payload):
    """The forecast of one zone under one plan."""

    zone: str
    problem: str | None = Field(description="why there is no forecast; null if there is one")
    sample_time: AwareDatetime | None
    issue_time: AwareDatetime | None
    valid_time: AwareDatetime | None = Field(description="of the first entry of every array")
    period_s: float = Field(description="from one entry to the next, s")
    quality: Quality
    trust: HorizonTrust | None = Field(description="at the horizon of the request; null before the first sample")
    inputs: tuple[InputOrigin, ...]
    levels: list[float] = Field(description="of lower and upper")
    outputs: list[CompactOutputPayload]


class PlanForecastPayload(Payload):
    """All zones under one plan, simulated together."""

    name: str
    zones: list[ZoneForecastPayload]


class SiteForecastPayload(Payload):
    """Forecasts of several zones under several plans."""

    schema_version: Literal[1] = Field(default=1, alias="schema")
    site: str
    horizon_s: float
    plans: list[PlanForecastPayload]
