"""Trust in a zone's forecasts, horizon by horizon: by verified forecasts, findings, and what disturbs the zone now.

Trust falls as soon as a threshold is crossed. It rises only after RISES judgements in a row, an hour apart, that clear
the threshold by a margin, so that a controller does not switch to and fro.

A controller that plans the heating asks what the model is worth once the heating is known: the hindsight of the skill.
Whoever reads the published forecast asks what it was worth as it was issued. Intervals that held too little then, or a
simpler forecast that was better, make it doubtful at most: that the heating was not foreseen is no fault that a plan
does not mend.
"""

from dataclasses import replace
from typing import NamedTuple

from adapters.fields.durations import spoken_duration
from estimator.diagnosis.finding import AGAINST_BALANCE, IMPLAUSIBLE, MISSES_SOMETHING, TELEMETRY, Diagnosis
from estimator.types import Outcome
from service.records.skill import Better, HorizonSkill, IssuedSkill, Skill
from service.records.trust import DOUBTFUL, LEARNING, TRUSTED, UNTRUSTED, HorizonTrust, Trust, compared
from service.records.update import Update

LOOKED_BACK = (1, 7)
"""Days whose verified forecasts are judged by."""
NEEDED = 24
"""Verified forecasts in seven days below which a horizon is still being learned."""
NEEDED_OF_DAY = 12
"""Verified forecasts in a day from which that day alone may lower the trust."""
RISES = 6
"""Judgements in a row, an hour apart, that a better level takes."""
NOTABLE = 0.25
"""K: an RMSE up to which it does not matter that persistence is better."""
WIDER, WIDE = 2.0, 1.5
"""Widths of the standing interval, as multiples of the mean width of seven days, at which a disturbance begins in the
high regime of alpha, and at which it ends."""
DISTURBED_UP_TO = 21600
"""s: a disturbance of this moment lowers the trust in horizons up to this one."""
FROM_HOURS = 21600
"""s: horizons from this one on hang on the heat loss, which some findings doubt."""


class Threshold(NamedTuple):
    """What a level asks of verified forecasts, and what coming back to it asks."""

    coverage: float
    """Of the 95 % interval over seven days."""
    day_coverage: float
    """The same over the last day."""
    skill: float
    """Against persistence, over seven days."""


BELOW = {DOUBTFUL: Threshold(0.85, 0.70, 0.0), UNTRUSTED: Threshold(0.70, 0.40, -0.5)}
"""Anything below these is at most at this level."""
BACK = {DOUBTFUL: Threshold(0.90, 0.80, 0.05), UNTRUSTED: Threshold(0.75, 0.50, -0.4)}
"""Nothing may be below these for a level to be left upwards."""
_RANK = {TRUSTED: 0, DOUBTFUL: 1, LEARNING: 2, UNTRUSTED: 2}

Verdict = tuple[str, str]
"""A level, and the sentence that explains it."""


def judged(before: Trust, update: Update, skill: Skill | None, diagnosis: Diagnosis) -> Trust:
    """Trust after `update`; `skill` is given once an hour and for the first judgement."""
    after = before if skill is None else _reviewed(before, update.time, skill, diagnosis)
    high = update.gate is not None and update.gate.regime == "high"
    # An interval of 95 % of a Gaussian, whatever levels are published.
    width = 2.0 * 1.96 * update.forecast.outputs[0].sd
    disturbed = high and width > (WIDE if before.disturbed else WIDER) * after.usual > 0.0
    lies = next((found.sentence for found in diagnosis.findings if found.finding in TELEMETRY), "")
    horizons = tuple(_told(one, update, disturbed, lies) for one in after.horizons)
    return compared(replace(after, time=update.time, horizons=horizons, disturbed=disturbed))


def _reviewed(before: Trust, now: int, skill: Skill, diagnosis: Diagnosis) -> Trust:
    """`before` with what the verified forecasts of `skill` and the findings say, every hour."""
    old = {one.lead: one for one in before.horizons}
    issued, of_day = ({one.lead: one for one in skill.issued_over(days)} for days in (7, 1))
    better, latest = skill.better(7), skill.better(1)
    horizons = []
    for week, day in zip(skill.over(7), skill.over(1), strict=True):
        lead = week.lead
        one = _verified(old.get(lead, HorizonTrust(lead, LEARNING, "", now)), week, day, diagnosis)
        beaten = better.get(lead) if day.forecasts < NEEDED or lead in latest else None
        horizons.append(_issued(one, issued.get(lead), of_day.get(lead), beaten))
    usual = skill.over(7)[0].width
    good = [one.lead for one in skill.over(7) if one.forecasts >= NEEDED and one.lead not in better]
    return replace(
        before,
        horizons=tuple(horizons),
        beaten="",
        better=tuple(better.values()),
        good_up_to=max((lead for lead in good if lead < min(better, default=lead + 1)), default=0),
        usual=usual if usual > 0.0 else 0.0,
    )


def _verified(old: HorizonTrust, week: HorizonSkill, day: HorizonSkill, diagnosis: Diagnosis) -> HorizonTrust:
    """The horizon by its verified forecasts and the findings; `old` is what it was an hour ago."""
    (level, why), strict = _verdict(week, day, diagnosis, BELOW), _verdict(week, day, diagnosis, BACK)
    if LEARNING in (level, old.verified) or _RANK[level] >= _RANK[old.verified]:
        return replace(old, verified=level, why=why, rising=0)
    # The evidence would do for more trust. It has to do so by a margin, and for some hours.
    rising = old.rising + 1 if _RANK[strict[0]] < _RANK[old.verified] else 0
    if rising >= RISES:
        return replace(old, verified=strict[0], why=strict[1], rising=0)
    why = old.why if strict[0] == old.verified else f"it has been better for {rising} h; trust rises after {RISES} h"
    return replace(old, why=why or strict[1], rising=rising)


def _issued(
    one: HorizonTrust, week: IssuedSkill | None, day: IssuedSkill | None, better: Better | None
) -> HorizonTrust:
    """The horizon with what its forecasts were worth as issued (one step ahead: None), and what simpler one was
    `better`. A good last day makes up for no interval here: what was foreseen depends on what day it was."""
    reason = _held_too_little(week, day, BELOW[DOUBTFUL])
    if reason is None and better is not None and better.own > NOTABLE:
        reason = str(better)
    if reason is not None:
        return replace(one, issued=DOUBTFUL, issued_why=reason, issued_rising=0)
    if one.issued == TRUSTED:
        return one
    rising = one.issued_rising + 1 if _held_too_little(week, day, BACK[DOUBTFUL]) is None else 0
    if rising >= RISES:
        return replace(one, issued=TRUSTED, issued_why="", issued_rising=0)
    return replace(one, issued_rising=rising)


def _held_too_little(week: IssuedSkill | None, day: IssuedSkill | None, threshold: Threshold) -> str | None:
    """Which part of `threshold` the coverage as issued fails, as a sentence."""
    for window, needed, least, when in (
        (day, NEEDED_OF_DAY, threshold.day_coverage, "in the last day"),
        (week, NEEDED, threshold.coverage, "in 7 days"),
    ):
        if window is not None and window.forecasts >= needed and window.coverage < least:
            return (
                f"{_held(window, when)}, as published, when nobody knew the heating and the weather to come; under a "
                "plan of the heating they may hold"
            )
    return None


def _held(window: HorizonSkill | IssuedSkill, when: str) -> str:
    share = f"{100.0 * window.coverage:.0f} %"
    return f"the 95 % intervals {spoken_duration(window.lead)} ahead held {share} of what came {when}"


def _verdict(week: HorizonSkill, day: HorizonSkill, diagnosis: Diagnosis, thresholds: dict[str, Threshold]) -> Verdict:
    if week.forecasts < NEEDED:
        count = f"{week.forecasts} forecasts {spoken_duration(week.lead)} ahead were verified in 7 days"
        return LEARNING, f"{count}; it takes {NEEDED}"
    findings = {finding.finding: finding.sentence for finding in diagnosis.findings}
    if IMPLAUSIBLE in findings:
        return UNTRUSTED, findings[IMPLAUSIBLE]
    for level in (UNTRUSTED, DOUBTFUL):
        if (reason := _below(week, day, thresholds[level])) is not None:
            return level, reason
    doubts = (AGAINST_BALANCE, MISSES_SOMETHING) if week.lead >= FROM_HOURS else ()
    return next(((DOUBTFUL, findings[name]) for name in doubts if name in findings), (TRUSTED, ""))


def _below(week: HorizonSkill, day: HorizonSkill, threshold: Threshold) -> str | None:
    """Which part of `threshold` the forecasts fail, as a sentence. A last day that alone does what is asked of seven
    makes up for the days before it: a model that has learned since is judged by what it does now."""
    if day.forecasts >= NEEDED_OF_DAY:
        if day.coverage < threshold.day_coverage:
            return _held(day, "in the last day")
        if day.coverage >= threshold.coverage and _skilful(day, threshold):
            return None
    if week.coverage < threshold.coverage:
        return _held(week, "in 7 days")
    if not _skilful(week, threshold):
        return (
            f"forecasts {spoken_duration(week.lead)} ahead were off by {week.rmse:.2f} K in 7 days, and a forecast of "
            f"no change by {week.persistence_rmse:.2f} K"
        )
    return None


def _skilful(window: HorizonSkill, threshold: Threshold) -> bool:
    # What is not a number is no evidence against the forecasts.
    return not (window.rmse > NOTABLE and window.skill_against_persistence < threshold.skill)


def _told(one: HorizonTrust, update: Update, disturbed: bool, lies: str) -> HorizonTrust:
    """The horizon as it is published: as verified, unless this moment is worse; `lies` says what of the telemetry is
    not to be believed."""
    level, reason = one.verified, one.why
    if update.outcome == Outcome.VANISHED:
        level, reason = UNTRUSTED, "the model cannot explain the last measurement"
    elif lies and level != LEARNING:
        level, reason = UNTRUSTED, lies
    elif disturbed and level == TRUSTED and one.lead <= DISTURBED_UP_TO:
        level, reason = DOUBTFUL, "an open window, people or other heat that nobody measures acts on the room"
    planned = level
    if level == TRUSTED and one.issued == DOUBTFUL:
        level, reason = DOUBTFUL, one.issued_why
    if (level, planned, reason) == (one.level, one.planned, one.reason):
        return one
    since = one.since if level == one.level else update.time
    return replace(one, level=level, planned=planned, reason=reason, since=since)
