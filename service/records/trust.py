"""How far a controller may rely on a zone's forecasts."""

from __future__ import annotations

from typing import NamedTuple

LEARNING, TRUSTED, DOUBTFUL, UNTRUSTED = LEVELS = ("learning", "trusted", "doubtful", "untrusted")
"""Too few forecasts were verified; plan with them; plan with care; do not plan with them."""


class HorizonTrust(NamedTuple):
    """Trust in the forecasts of one horizon; times are UTC s."""

    lead: int
    """From the last sample that the forecast knew to the one that it is about, s."""
    level: str
    """One of LEVELS, as published."""
    reason: str
    """One sentence; empty while trusted."""
    since: int
    """When `level` was reached."""
    verified: str = LEARNING
    """The level by verified forecasts and findings alone, without what is disturbed at this moment."""
    why: str = ""
    """The sentence for `verified`."""
    rising: int = 0
    """How many judgements in a row found a better level than `verified`."""


class Trust(NamedTuple):
    """Trust in the forecasts of every horizon, from the shortest; none before the first sample."""

    time: int = 0
    """Of the sample after which it was judged, UTC s."""
    horizons: tuple[HorizonTrust, ...] = ()
    disturbed: bool = False
    """Whether something acts on the zone now that its model does not know."""
    usual: float = 0.0
    """Mean width [K] of the 95 % intervals one step ahead in seven days, when it was last looked up."""

    def at(self, lead: float) -> HorizonTrust | None:
        """The horizon that a forecast over `lead` s falls into: the shortest that is not shorter, else the longest."""
        beyond = [one for one in self.horizons if one.lead >= lead]
        return beyond[0] if beyond else self.horizons[-1] if self.horizons else None


def untrusted(trust: Trust, reason: str) -> Trust:
    """`trust` of a zone that can no longer vouch for its forecasts, and why."""
    told = tuple(one._replace(level=UNTRUSTED, reason=reason) for one in trust.horizons)
    return trust._replace(horizons=told)
