"""The tables of kind "schedule": a week of values that the configuration itself says."""

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal, Self
from zoneinfo import ZoneInfo

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from adapters.channel import ChannelConfig, SourceConfig
from adapters.fields.tables import Table
from adapters.fields.values import Country, Number, Text, TimeZone, check, matching
from adapters.fields.words import listed
from adapters.holidays import public_holidays
from adapters.schedule.week import HOLIDAY, WEEKDAYS, Week
from adapters.timestamps import Array

_DAYS = (*WEEKDAYS, HOLIDAY)
_clock = check(matching(r"([01]\d|2[0-3]):([0-5]\d)"), 'must be a time of day such as "06:30", not {}')
_day = check(lambda value: value if value in _DAYS else None, f"must be one of {', '.join(_DAYS)}, not {{}}")


class DaysConfig(Table):
    """`days`: days of the week that have the same values at the same times."""

    on: tuple[Annotated[str, BeforeValidator(_day)], ...] = Field(
        min_length=1, description='a list of days, such as ["mon", "tue"]; `"holiday"`: public holidays'
    )
    at: Mapping[Annotated[str, BeforeValidator(_clock)], Number] = Field(
        min_length=1, description='values by the time of day from which they hold, such as { "06:30" = 21.0 }'
    )


def _whole_week(days: tuple[DaysConfig, ...]) -> tuple[DaysConfig, ...]:
    named = [day for one in days for day in one.on]
    twice = [day for day in dict.fromkeys(named) if named.count(day) > 1]
    if twice:
        raise ValueError(f"{listed(twice, 7)} named twice; name every day once")
    missing = [day for day in WEEKDAYS if day not in named]
    if missing:
        raise ValueError(f"nothing for {listed(missing, 7)}; name every day of the week once")
    return days


_Days = Annotated[tuple[DaysConfig, ...], AfterValidator(_whole_week)]


def _of_a_country(days: tuple[DaysConfig, ...], country: str | None) -> None:
    """ValueError for values of public holidays of no country."""
    if country is None and any(HOLIDAY in one.on for one in days):
        raise ValueError('days has values for "holiday"; give the country whose public holidays are meant')


class ScheduleChannelConfig(ChannelConfig):
    """A channel of a schedule. What it does not have is its source's."""

    unit: Text = Field(default="degC", description="unit of the values")
    days: _Days | None = Field(default=None, description="another week than the source's")
    time_zone: TimeZone | None = Field(default=None, description="another time zone than the source's")
    country: Country | None = Field(default=None, description="another country than the source's")

    @property
    def address(self) -> str:
        return f"the schedule {self.source}"

    @property
    def known_values(self) -> Sequence[float]:
        return [value for one in self.days or () for value in one.at.values()]

    def within(self, table: Any) -> Self:
        found = super().within(table)
        _of_a_country(found.days or (), found.country)
        return found

    @property
    def week(self) -> Week:
        """What it follows; of a channel within its source."""
        assert self.days is not None
        assert self.time_zone is not None
        changes = {day: {_hours(at): one.at[at] for at in sorted(one.at)} for one in self.days for day in one.on}
        holidays = () if self.country is None else public_holidays(self.country)
        return Week(changes, ZoneInfo(self.time_zone), holidays)

    def foreknown(self, unit: str) -> Callable[[Array], Array]:
        week, edge = self.week, self.edge(unit)
        return lambda times: np.array([edge.value(value) for value in week.values(times).tolist()])


class ScheduleConfig(SourceConfig):
    """[sources.<name>] of kind "schedule": a week of values."""

    live: ClassVar = True
    channel: ClassVar = ScheduleChannelConfig
    example: ClassVar = 'unit = "degC"'
    source: ClassVar = "adapters.schedule.source:ScheduleSource"

    kind: Literal["schedule"] = "schedule"
    time_zone: TimeZone = Field(description='the time zone of the times, such as "Europe/Berlin"')
    country: Country | None = Field(default=None, description='whose public holidays count, such as "DE-BW"')
    days: _Days = Field(
        description='a list of tables such as { on = ["sat", "sun"], at = { "08:00" = 20.0, "22:00" = 17.0 } }'
    )

    @model_validator(mode="after")
    def _holidays_of_a_country(self) -> Self:
        _of_a_country(self.days, self.country)
        return self

    @property
    def described(self) -> str:
        return f"a weekly schedule in {self.time_zone}"


def _hours(clock: str) -> float:
    hours, minutes = clock.split(":")
    return int(hours) + int(minutes) / 60.0
