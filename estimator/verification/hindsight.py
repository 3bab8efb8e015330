"""Forecasts hours ahead, held to what came.

Every hour each member of a group issues a forecast: a small sample of its state. When the time of one of its leads has
come, the sample is unfolded under the inputs that really followed, and the distribution that results is what is scored.
So a model is judged by what it makes of the inputs, not by how well anybody foresaw them.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from estimator.arrays import Array, under
from estimator.network.network import Network
from estimator.types import Estimator, Mixture

HORIZONS = (3600.0, 21600.0, 86400.0)
"""Leads that are verified beside one step [s]."""

SAMPLES = 32
"""Size of the sample that stands for a state."""

EVERY = 3600.0
"""Time from one issue to the next [s]."""


def issued_at(time: float, period: float, seed: int) -> bool:
    """Whether live forecasts from a state at `time` [UTC s] are verified, one every EVERY s; `seed` spreads the zones
    of a site over it."""
    every = max(1, round(EVERY / period))
    return round(time / period) % every == seed % every


class Issue(NamedTuple):
    """What each member issued for the time of step `step` and what follows."""

    step: int
    samples: tuple[Any, ...]
    note: Array
    """What their owner wants to know again when they are due."""


class Pending(NamedTuple):
    """Issues whose time has not come, and the inputs since the oldest of them, or since some time before."""

    step: int
    inputs: Array
    """(m, n_u): drive rows of the last m steps, the newest last; at least the newest, from the first step on."""
    issues: tuple[Issue, ...]


class Due(NamedTuple):
    """What the members had forecast for now, `lead` steps ahead of the last sample that they knew."""

    horizon: int
    """Place in HORIZONS."""
    lead: int
    mixtures: tuple[Mixture, ...]
    note: Array
    """As it was at the issue."""
    samples: tuple[Any, ...]
    """What they had issued."""


NOTHING = np.empty(0)


class Hindsight:
    """The pending forecasts of `members`, which share network inputs, outputs and period."""

    def __init__(self, network: Network, members: Sequence[Estimator], period: float, before: int = 0) -> None:
        """`network` is the one whose drive rows come; each member takes what drives its own. So many rows `before` the
        oldest issue are kept as well."""
        self._members, self._before = tuple(members), before
        self._width = len(network.drive)
        self._columns = [network.columns(member.network) for member in members]
        self.leads = tuple(round(horizon / period) for horizon in HORIZONS)
        """Steps ahead of each horizon; a horizon of one step or less is not verified here."""
        self.every = max(1, round(EVERY / period))
        """Steps from one issue to the next."""

    def start(self) -> Pending:
        """Nothing is pending."""
        return Pending(0, np.zeros((0, self._width)), ())

    def advance(
        self,
        pending: Pending,
        inputs: Array,
        states: Sequence[Any],
        phase: int,
        note: Callable[[], Array] | None = None,
    ) -> Pending:
        """One step on under `inputs` (n_u,): `states` are the members', predicted to the new step.

        Every EVERY s a forecast is issued, with its `note`, in one group at the steps that leave the remainder `phase`.
        """
        step, longest = pending.step + 1, max(self.leads)
        issues = pending.issues
        while issues and step - issues[0].step >= longest:
            issues = issues[1:]
        if step % self.every == phase % self.every and longest > 1:
            samples = tuple(member.issue(state, SAMPLES) for member, state in zip(self._members, states, strict=True))
            issues = (*issues, Issue(step, samples, NOTHING if note is None else note()))
        kept = self._before + (max(1, step - issues[0].step) if issues else 1)
        log = np.concatenate([pending.inputs, inputs[None]])
        return Pending(step, log[-kept:], issues)

    def due(self, pending: Pending) -> Iterator[Due]:
        """What had been forecast for the present step, from the shortest lead to the longest."""
        waiting = {issue.step: issue for issue in pending.issues}
        for horizon, lead in enumerate(self.leads):
            issue = waiting.get(pending.step - lead + 1)
            if lead > 1 and issue is not None:
                plan = pending.inputs[len(pending.inputs) - (lead - 1) :]
                issued = zip(self._members, issue.samples, self._columns, strict=True)
                mixtures = tuple(member.unfold(sample, plan[:, own]).at(-1) for member, sample, own in issued)
                yield Due(horizon, lead, mixtures, issue.note, issue.samples)

    def pack(self, pending: Pending) -> dict[str, Array]:
        """The arrays of `pending`, by name."""
        arrays = {
            "step": np.array(pending.step),
            "inputs": pending.inputs,
            "issued": np.array([issue.step for issue in pending.issues], dtype=np.int64),
        }
        if pending.issues and pending.issues[0].note.size:
            arrays["note"] = np.stack([issue.note for issue in pending.issues])
        for place in range(len(self._members)):
            packed = [issue.samples[place]._asdict() for issue in pending.issues]
            for name in packed[0] if packed else ():
                arrays[f"{place}.{name}"] = np.stack([one[name] for one in packed])
        return arrays

    def unpack(self, arrays: Mapping[str, Array]) -> Pending:
        """The pending forecasts of packed arrays."""
        steps = arrays["issued"].tolist()
        samples: list[Iterable[Any]] = []
        for place, member in enumerate(self._members):
            own, kind = under(f"{place}.", arrays), member.issue_type
            samples.append([kind(**{name: value[row] for name, value in own.items()}) for row in range(len(steps))])
        notes = arrays.get("note", [NOTHING] * len(steps))
        issues = tuple(Issue(*each) for each in zip(steps, zip(*samples, strict=True), notes, strict=True))
        return Pending(int(arrays["step"]), arrays["inputs"], issues)
