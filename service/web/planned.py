"""What a plan may say of an input in JSON, for one zone and for many."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import numpy as np
from pydantic import BaseModel, Field, ValidationError, WrapValidator
from pydantic_core.core_schema import ValidatorFunctionWrapHandler

from service.forecast.plan import Stepped, Timed, Values
from service.forecast.request import MAX_STEPS
from service.web.models import EXAMPLES, Finite, Horizon, Instant, Levels

MAX_INPUTS = 64


class TimedValue(BaseModel, extra="forbid"):
    """A value that holds from a time on."""

    time: Instant = Field(description="RFC 3339 with zone")
    value: Finite


class SteppedValues(BaseModel, extra="forbid"):
    """One value for each step of a coarser grid than the zone's."""

    step: Horizon = Field(description="a whole number of the zone's periods, counted from valid_time")
    values: Annotated[list[Finite], Field(min_length=1, max_length=MAX_STEPS)]


def _planned(value: object, read: ValidatorFunctionWrapHandler, *, unit: str) -> Values:
    """As the grammar of plans has it; one sentence where it is no plan, for every arm of the union would complain."""
    if isinstance(value, list) and len(value) > MAX_STEPS:
        raise ValueError(f"at most {MAX_STEPS} values of an input, not {len(value)}")
    try:
        found = read(value)
    except ValidationError as error:
        # A mistake inside a value is worth more than that none of the forms fits.
        told = next((one["msg"] for one in error.errors() if one["type"] == "value_error"), None)
        forms = f"give a finite number, one number per period, a list of {{time, value}}, or {{step, values}}{unit}"
        raise ValueError(forms if told is None else f"{told.removeprefix('Value error, ')}; {forms}") from None
    if isinstance(found, SteppedValues):
        return Stepped(found.step, np.array(found.values))
    if not isinstance(found, list):
        return float(found)
    if timed := [one for one in found if isinstance(one, TimedValue)]:
        return Timed(np.array([one.time.timestamp() for one in timed]), np.array([one.value for one in timed]))
    return np.array(found, dtype=np.float64)


if TYPE_CHECKING:
    PlannedInput = Values
    PlannedPrice = Values
else:
    _Forms = (
        Finite
        | Annotated[list[Finite], Field(max_length=MAX_STEPS)]
        | Annotated[list[TimedValue], Field(min_length=1, max_length=MAX_STEPS)]
        | SteppedValues
    )
    PlannedInput = Annotated[_Forms, WrapValidator(partial(_planned, unit=", in the network's unit"))]
    PlannedPrice = Annotated[_Forms, WrapValidator(partial(_planned, unit=""))]


class ForecastRequest(
    BaseModel, extra="forbid", strict=True, json_schema_extra={"examples": EXAMPLES["ForecastRequest"]}
):
    """Body of POST /zones/{zone}/forecast: a forecast under planned inputs."""

    horizon: Horizon = Field(description="how far beyond valid_time to forecast; a whole number of periods")
    levels: Levels = Field(default_factory=list, description="levels of the intervals; default: the published ones")
    inputs: dict[str, PlannedInput] = Field(
        default_factory=dict,
        max_length=MAX_INPUTS,
        description=(
            "planned values per input channel, in the network's unit: one number for the whole horizon, one per step, "
            "of which the first holds from valid_time to valid_time + period_s, {step, values} on a coarser grid, or "
            "values with times; channels not named are foreseen"
        ),
    )


Plans = TypeVar("Plans", bound=Sequence[Any])


def named_apart(plans: Plans) -> Plans:
    """`plans`, of which no two have the same `name`, unless it is none; ValueError otherwise."""
    names = [plan.name for plan in plans if plan.name]
    if twice := [name for name in names if names.count(name) > 1]:
        raise ValueError(f"two plans are named '{twice[0]}'; give each another name")
    return plans
