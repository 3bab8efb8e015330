"""How the forecasts of a zone have turned out."""

from __future__ import annotations

from typing import Literal, Self

from service.records.record import Number, Time, constant, record, shown


@record
class Verified:
    """What verified forecasts of one horizon were worth, however they are judged."""

    lead: int = shown("from the last sample that the forecast knew to the one that it is about, s", key="lead_s")
    forecasts: int = shown("how many were verified")
    coverage: Number = shown("share of them whose interval held what came, 0 to 1")
    crps: Number = shown("mean continuous ranked probability score, K")
    rmse: Number = shown("root mean square error of the mean, K")
    width: Number = shown("mean width of the interval, K")
    persistence_rmse: Number = shown("of the forecast that nothing changes, K")


@record
class HorizonSkill(Verified):
    """What the verified forecasts of one horizon were worth."""

    arx_rmse: Number = shown("of a linear regression on past outputs and inputs, learned online, K")
    skill_against_persistence: Number = shown("1 - rmse / persistence_rmse; above 0 is better than it")
    skill_against_arx: Number = shown("1 - rmse / arx_rmse")

    @classmethod
    def of(
        cls,
        lead: int,
        forecasts: int,
        coverage: float,
        crps: float,
        rmse: float,
        width: float,
        persistence_rmse: float,
        arx_rmse: float,
    ) -> Self:
        """The same with the skill against both references."""
        against = _smaller(rmse, persistence_rmse), _smaller(rmse, arx_rmse)
        return cls(lead, forecasts, coverage, crps, rmse, width, persistence_rmse, arx_rmse, *against)


@record
class IssuedSkill(Verified):
    """What the forecasts of one horizon were worth as they were issued, with the inputs that were foreseen then."""

    yesterday_rmse: Number = shown("of the measurement a day before, K; on the first day, of persistence")
    persistence_crps: Number = shown("mean absolute error of persistence, which is the CRPS of a number, K")
    yesterday_crps: Number = shown("the same of the measurement a day before, K")


@record
class SkillWindow:
    """The horizons over one window."""

    days: int
    horizons: tuple[HorizonSkill, ...] = shown(
        "one step, 1 h, 6 h, 24 h, in hindsight: with the heating and the weather known"
    )
    as_issued: tuple[IssuedSkill, ...] = shown(
        "1 h, 6 h, 24 h as published: when nobody knew the heating and the weather", default=()
    )


@record
class MemberWeights:
    """What one member of a bank weighs."""

    member: str
    weights: tuple[Number, ...] = shown("at each horizon, 0 to 1")


@record
class Skill:
    """The zone's own forecasts held to what came: under the inputs that really followed, and as they were issued."""

    time: Time = shown("the newest sample that was compared with a forecast", key="sample_time")
    unit: Literal["K"] = constant("K", "unit of crps, rmse and width")
    level: float = shown("of the interval whose coverage is counted")
    windows: tuple[SkillWindow, ...] = shown("the last day, 7 days, 30 days")
    members: tuple[MemberWeights, ...] = shown("of a bank; empty for other estimators")

    def over(self, days: int) -> tuple[HorizonSkill, ...]:
        """The horizons of the window that looks back so many days."""
        return next(window.horizons for window in self.windows if window.days == days)

    def issued_over(self, days: int) -> tuple[IssuedSkill, ...]:
        """The same of the forecasts as they were issued."""
        return next(window.as_issued for window in self.windows if window.days == days)

    @property
    def longest(self) -> tuple[HorizonSkill, ...]:
        """The horizons of the window that looks back furthest."""
        return self.windows[-1].horizons


def _smaller(own: float, other: float) -> float:
    """The share by which an RMSE is smaller than another; negative where it is larger."""
    return 1.0 - own / other if other > 0.0 else float("nan")
