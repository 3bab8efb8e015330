"""What a controller sends, and the payloads that it gets."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, Field

from adapters.reading import Quality
from service.records.fan import CompactOutputPayload
from service.records.outlook import InputOrigin
from service.records.record import Time, record, shown
from service.records.trust import HorizonTrust
from service.web.models import EXAMPLES, Horizon, Levels
from service.web.planned import PlannedInput, named_apart

MAX_DRAWS = 1000
MAX_PLANS = 64
MAX_ZONES = 500


class SitePlan(BaseModel, extra="forbid"):
    """A plan for the site: the inputs of each zone."""

    name: str = Field(default="", max_length=64, description="comes back with the answer")
    inputs: dict[str, dict[str, PlannedInput]] = Field(
        default_factory=dict,
        max_length=MAX_ZONES + 1,
        description='by zone, then by input channel; the zone "*" stands for every zone that has the input',
    )


class SiteForecastRequest(BaseModel, extra="forbid", json_schema_extra={"examples": EXAMPLES["SiteForecastRequest"]}):
    """Body of POST /forecasts."""

    horizon: Horizon = Field(description="how far beyond valid_time; a whole number of each zone's periods")
    zones: Annotated[list[str], Field(max_length=MAX_ZONES)] = Field(
        default_factory=list, description="ids; default: every zone"
    )
    levels: Levels = Field(default_factory=list, description="levels of the intervals; default: the published ones")
    scenarios: int = Field(default=0, ge=0, le=MAX_DRAWS, description="sampled futures of each zone and plan")
    plans: Annotated[list[SitePlan], Field(min_length=1, max_length=MAX_PLANS), AfterValidator(named_apart)] = Field(
        default_factory=lambda: [SitePlan()], description="default: one plan that plans nothing"
    )


@record
class ZoneForecastPayload:
    """The forecast of one zone under one plan."""

    zone: str
    problem: str | None = shown("why there is no forecast; null if there is one")
    sample_time: Time | None
    issue_time: Time | None
    valid_time: Time | None = shown("of the first entry of every array")
    period_s: float = shown("from one entry to the next, s")
    quality: Quality
    trust: HorizonTrust | None = shown("at the horizon of the request; null before the first sample")
    inputs: tuple[InputOrigin, ...]
    levels: tuple[float, ...] = shown("of lower and upper")
    outputs: tuple[CompactOutputPayload, ...]


@record
class PlanForecastPayload:
    """All zones under one plan, simulated together."""

    name: str
    zones: tuple[ZoneForecastPayload, ...]


@record
class SiteForecastPayload:
    """Forecasts of several zones under several plans."""

    horizon_s: float
    plans: tuple[PlanForecastPayload, ...]
