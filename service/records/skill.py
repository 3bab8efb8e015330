"""How the forecasts of a zone have turned out."""

from typing import Literal, NamedTuple, Self

from adapters.fields.durations import spoken_duration
from service.records.record import Number, Time, constant, record, shown

ENOUGH = 24
"""Verified forecasts before they are held to simpler ones."""
ALIKE = 0.05
"""K by which an RMSE is smaller than another one where that matters; above 1 K, the share of it."""


class Better(NamedTuple):
    """A simpler forecast that was better at a horizon."""

    lead: int
    name: str
    error: float
    """Its RMSE [K]."""
    own: float
    """RMSE [K] of the zone's forecasts."""

    def __str__(self) -> str:
        return (
            f"{spoken_duration(self.lead)} ahead, {self.name} is the better forecast: off by {self.error:.2f} K in 7 "
            f"days, the model by {self.own:.2f} K"
        )


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

    @property
    def simpler(self) -> tuple[tuple[str, float], ...]:
        """Simpler forecasts by name, and the RMSE of each."""
        return (("no change", self.persistence_rmse),)

    @property
    def better(self) -> Better | None:
        """The best of the simpler forecasts, where that is better by more than ALIKE."""
        known = [(error, name) for name, error in self.simpler if error > 0.0]
        if self.forecasts < ENOUGH or not known:
            return None
        error, name = min(known)
        return Better(self.lead, name, error, self.rmse) if self.rmse - error > ALIKE * max(1.0, error) else None


@record
class HorizonSkill(Verified):
    """What the verified forecasts of one horizon were worth."""

    arx_rmse: Number = shown("of a linear regression on past outputs and inputs, learned online, K")
    skill_against_persistence: Number = shown("1 - rmse / persistence_rmse; above 0 is better than it")
    skill_against_arx: Number = shown("1 - rmse / arx_rmse")

    @property
    def simpler(self) -> tuple[tuple[str, float], ...]:
        """The same with the regression."""
        return (("no change", self.persistence_rmse), ("a simple estimate from the last hours", self.arx_rmse))

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

    @property
    def simpler(self) -> tuple[tuple[str, float], ...]:
        """The same with the day before."""
        return (("no change", self.persistence_rmse), ("the same hour yesterday", self.yesterday_rmse))


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

    def better(self, days: int) -> dict[int, Better]:
        """What was better than the zone's forecasts, as issued or in hindsight, by lead [s], from the shortest."""
        found = filter(None, (one.better for one in (*self.issued_over(days), *self.over(days))))
        # Of two at one lead the one that is better by more.
        return {one.lead: one for one in sorted(found, key=lambda one: (one.lead, one.own - one.error))}

    @property
    def longest(self) -> tuple[HorizonSkill, ...]:
        """The horizons of the window that looks back furthest."""
        return self.windows[-1].horizons


def _smaller(own: float, other: float) -> float:
    """The share by which an RMSE is smaller than another; negative where it is larger."""
    return 1.0 - own / other if other > 0.0 else float("nan")
