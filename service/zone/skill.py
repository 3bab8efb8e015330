"""The skill of a zone, from what its loop has verified."""

from collections.abc import Iterator, Sequence
from typing import Any

from estimator.loop import Carried, Loop
from estimator.verification.skill import IssuedScores, Scores
from estimator.verification.verification import LEVEL
from service.records.skill import HorizonSkill, IssuedSkill, MemberWeights, Skill, SkillWindow

WINDOWS = (1, 7, 30)
"""Days that a skill looks back."""


def skill_of(loop: Loop, carried: Carried, time: int, looking_back: Sequence[int] = WINDOWS) -> Skill:
    """What the forecasts up to the sample at `time` [UTC s], which left `carried`, were worth over some days."""
    standing = carried.standing
    assert standing is not None
    assert standing.verified is not None, "a zone verifies its forecasts"
    windows = []
    for days in looking_back:
        known = _rows(loop.verification.leads, loop.verification.scores(standing.verified, time, days))
        issued = _rows(loop.as_issued.leads, loop.as_issued.scores(standing.issued, time, days))
        horizons = tuple(HorizonSkill.of(**row) for row in known)
        windows.append(SkillWindow(days, horizons, tuple(IssuedSkill(**row) for row in issued)))
    weights = loop.estimator.member_weights(standing.state)
    members = tuple(MemberWeights(name, tuple(map(float, each))) for name, each in weights.items())
    return Skill(time, LEVEL, tuple(windows), members)


def _rows(leads: Sequence[int], scores: Scores | IssuedScores) -> Iterator[dict[str, Any]]:
    """Of each horizon the lead, and what the `scores` (H,) say."""
    columns = {name: column.tolist() for name, column in scores._asdict().items()}
    for place, lead in enumerate(leads):
        row = {name: column[place] for name, column in columns.items()}
        yield row | {"lead": lead, "forecasts": int(row["forecasts"])}
