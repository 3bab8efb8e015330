"""How far a controller may rely on a zone's forecasts."""

from dataclasses import replace

from adapters.fields.durations import spoken_duration
from service.records.record import Time, hidden, record, shown
from service.records.skill import Better

LEARNING, TRUSTED, DOUBTFUL, UNTRUSTED = LEVELS = ("learning", "trusted", "doubtful", "untrusted")
"""Too few forecasts were verified; plan with them; plan with care; do not plan with them."""


@record
class HorizonTrust:
    """Trust in the forecasts of one horizon."""

    lead: int = shown("from the last sample that a forecast knew to the one that it is about, s", key="lead_s")
    level: str = shown("learning, trusted, doubtful or untrusted: the forecast as it is published", key="trust")
    reason: str = shown("one sentence; empty while trusted")
    since: Time = shown("when it came to be so")
    verified: str = hidden(default=LEARNING)
    """The level by verified forecasts and findings alone, without what is disturbed at this moment."""
    why: str = hidden(default="")
    """The sentence for `verified`."""
    rising: int = hidden(default=0)
    """How many judgements in a row found a better level than `verified`."""
    planned: str = shown("the same of forecasts under a plan of the heating", default=LEARNING)
    issued: str = hidden(default=TRUSTED)
    """DOUBTFUL where the intervals held too little of what came, as they were issued; else TRUSTED."""
    issued_why: str = hidden(default="")
    """The sentence for `issued`."""
    issued_rising: int = hidden(default=0)
    """How many judgements in a row found a better level than `issued`."""


@record
class Trust:
    """How far a controller may rely on the zone's forecasts."""

    time: Time = shown("the sample after which it was judged", key="sample_time", default=0)
    disturbed: bool = shown(
        "true while something acts on the zone that its model does not know", default=False, kw_only=True
    )
    horizons: tuple[HorizonTrust, ...] = shown("from the shortest", default=())
    usual: float = hidden(default=0.0, kw_only=True)
    """Mean width [K] of the 95 % intervals one step ahead in seven days, when it was last looked up."""
    # Checkpoints hold the fields in the order of the constructor: what comes new comes last.
    beaten: str = shown(
        "where simpler forecasts were better in 7 days, and where to rely on the zone's now: a sentence, or empty",
        default="",
        kw_only=True,
    )
    good_up_to: int = shown(
        "the longest horizon up to which no simpler forecast was better in 7 days, s; 0: none, or none is verified",
        key="good_up_to_s",
        default=0,
        kw_only=True,
    )
    better: tuple[Better, ...] = hidden(default=(), kw_only=True)
    """The simpler forecasts of `beaten`, from the shortest horizon."""

    def at(self, lead: float) -> HorizonTrust | None:
        """The horizon that a forecast over `lead` s falls into: the shortest that is not shorter, else the longest."""
        beyond = [one for one in self.horizons if one.lead >= lead]
        return beyond[0] if beyond else self.horizons[-1] if self.horizons else None


def untrusted(trust: Trust, reason: str) -> Trust:
    """`trust` of a zone that can no longer vouch for its forecasts, and why."""
    told = tuple(replace(one, level=UNTRUSTED, planned=UNTRUSTED, reason=reason) for one in trust.horizons)
    return compared(replace(trust, horizons=told))


def compared(trust: Trust) -> Trust:
    """`trust` with the sentence `beaten` as its horizons are trusted now."""
    if not trust.better:
        return trust
    outdone = {one.lead for one in trust.better}
    good = [one for one in trust.horizons if one.verified == one.issued == TRUSTED and one.lead not in outdone]
    now = ", ".join(spoken_duration(one.lead) for one in good if one.level == TRUSTED)
    remedy = f"rely on the model {now} ahead" if now else f"do not rely on the model {'now' if good else 'yet'}"
    return replace(trust, beaten="; ".join([*map(str, trust.better), remedy]))
