"""Whether the daemon still works: the event loop turns, the threads answer, every zone gets on with its samples.

A zone without telemetry has nothing to do and is well. One whose sample is under way, or waits, without anything being
finished for a long time hangs, and only a restart of the process helps.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable, Mapping
from typing import NamedTuple

from service.zone.zone import Zone

LOOK_SECONDS = 1.0
"""How often it is looked."""
JOURNAL_SECONDS = 60.0
"""What the thread of the journal may take to answer: a slow disk needs seconds."""
HUNG_SECONDS = 300.0
"""What one sample may take, or the estimator's threads to answer: the first sample after an installation compiles the
numerical kernels, on a small machine for minutes."""


class Organ(NamedTuple):
    """A part that everything depends on: `ask` returns once it has answered, which may take `patience` s."""

    what: str
    ask: Callable[[], Awaitable[object]]
    patience: float


class Vitals:
    """Looks after the organs and the zones; `run` for as long as the daemon lives."""

    def __init__(self, zones: Mapping[str, Zone], organs: tuple[Organ, ...], patience: float = HUNG_SECONDS) -> None:
        self._zones, self._organs, self._patience = zones, organs, patience
        self._asked: dict[str, tuple[asyncio.Future[object], float]] = {}
        """The question that an organ has not answered yet, and since when (monotonic s)."""
        self._stuck: dict[str, tuple[int, float]] = {}
        """Zones with something to do: how many samples they had finished when it was first seen, and when that was."""

    async def run(self, look: Callable[[], None] = lambda: None) -> None:
        """Look every LOOK_SECONDS, for ever, and call `look` after each time."""
        while True:
            self.look(time.monotonic())
            look()
            await asyncio.sleep(LOOK_SECONDS)

    def problems(self) -> list[str]:
        """What does not work, one sentence each; nothing if all is well."""
        now = time.monotonic()
        found = [
            f"{organ.what} has not answered for {now - self._asked[organ.what][1]:.0f} s"
            for organ in self._organs
            if organ.what in self._asked and now - self._asked[organ.what][1] > organ.patience
        ]
        hung = self.hung()
        if hung:
            # Whom this is told need not be one who may know the zones.
            found.append(
                f"zones have not finished a sample for {self._patience:.0f} s or more: {len(hung)}; see the log"
            )
        return found

    def hung(self) -> list[str]:
        """The zones that do not get on."""
        now = time.monotonic()
        return [zone for zone, (_, since) in self._stuck.items() if now - since > self._patience]

    def look(self, now: float) -> None:
        """See what has answered and been finished at `now`, monotonic s, and ask anew where there was an answer."""
        for organ in self._organs:
            question, _ = self._asked.get(organ.what, (None, now))
            if question is None or question.done():
                if question is not None and not question.cancelled():
                    # An organ that answers with an error does answer; who uses it says what is wrong.
                    question.exception()
                self._asked[organ.what] = asyncio.ensure_future(organ.ask()), now
        still = {}
        for zone, state in ((zone, view.busy) for zone, view in self._zones.items()):
            if state.waiting:
                before = self._stuck.get(zone)
                still[zone] = before if before and before[0] == state.finished else (state.finished, now)
        self._stuck = still
