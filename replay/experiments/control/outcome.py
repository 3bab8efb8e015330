"""What came out for one building in one case, over seeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from replay.experiments.control.cases import Scene
from replay.experiments.control.front import share_of_the_way
from replay.experiments.control.loop import Lived
from replay.experiments.control.runs import PERFECT, THERMOSTAT, ControlRun
from replay.experiments.control.scores import Scores


class Seen(NamedTuple):
    """One seed: by controller the scores at its usual setting, those of all settings, and the life of each."""

    usual: Mapping[str, Scores]
    swept: Mapping[str, list[Scores]]
    lives: Mapping[str, Lived]

    def share(self, controller: str) -> float:
        """How far a controller is on the way from the thermostat to perfect knowledge; NaN where it is not known."""
        thermostat, perfect = self.swept.get(THERMOSTAT, []), self.swept.get(PERFECT, [])
        if len(thermostat) < 2 or len(perfect) < 2:
            return float("nan")
        return share_of_the_way(self.usual[controller], thermostat, perfect)


class Outcome(NamedTuple):
    """A building in a case; `seen` by seed. `scene` is that of the first seed."""

    scene: Scene
    seen: Mapping[int, Seen]

    @property
    def name(self) -> str:
        """Of the pair."""
        return f"{self.scene.building}, {self.scene.case}"

    @property
    def controllers(self) -> tuple[str, ...]:
        """Those that ran."""
        return tuple(next(iter(self.seen.values())).usual)

    def figures(self, controller: str, figure: Callable[[Scores], float]) -> list[float]:
        """One figure of a controller's scores for every seed."""
        return [figure(seen.usual[controller]) for seen in self.seen.values()]

    def shares(self, controller: str) -> list[float]:
        """`Seen.share` for every seed."""
        return [seen.share(controller) for seen in self.seen.values()]


def seen_of(runs: Mapping[ControlRun, tuple[Scores, Lived]]) -> Seen:
    """One seed from its runs, of which the first of a controller has its usual setting."""
    usual: dict[str, Scores] = {}
    swept: dict[str, list[Scores]] = {}
    lives: dict[str, Lived] = {}
    for run, (scored, lived) in runs.items():
        swept.setdefault(run.controller, []).append(scored)
        if run.controller not in usual:
            usual[run.controller], lives[run.controller] = scored, lived
    return Seen(usual, swept, lives)
