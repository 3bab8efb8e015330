"""The rhythm of polling: when the next poll is due, and whether one took too long."""

import asyncio
import logging

_log = logging.getLogger(__name__)


class Rhythm:
    """Polls every `every` s. They keep their rhythm; those that were missed are not made up for."""

    def __init__(self, what: str, every: float) -> None:
        """`what` is polled, for the log."""
        self.late = 0
        """How many polls began later than they should have by a whole `every` or more."""
        self._what, self._every, self._due = what, every, 0.0

    def begin(self, delay: float = 0.0) -> None:
        """The poll that comes was due `delay` s from now."""
        self._due = asyncio.get_running_loop().time() + delay

    async def wait(self) -> None:
        now = asyncio.get_running_loop().time()
        began, self._due = self._due, self._due + self._every
        if now < self._due + self._every:
            self._due = max(self._due, now)
        else:
            self._due = now
            self.late += 1
            if self.late == 1:
                say = "%s: a poll took %.1f s, poll is %.1f s; poll less often, or more in one request"
                _log.warning(say, self._what, now - began, self._every)
        await asyncio.sleep(self._due - now)
