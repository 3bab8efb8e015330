"""The rhythm of polling: when the next poll is due, and how many came too late."""

from __future__ import annotations


class Rhythm:
    """Polls every `every` s. They keep their rhythm; those that were missed are not made up for."""

    def __init__(self, every: float, now: float) -> None:
        """The first poll is due `now` (s on a clock that is never set)."""
        self._every, self._due = every, now
        self.late = 0
        """How many polls began later than they should have by a whole `every` or more."""

    def next(self, now: float) -> float:
        """When the poll after the one that ends `now` is due."""
        self._due += self._every
        if now < self._due + self._every:
            self._due = max(self._due, now)
        else:
            self.late += 1
            self._due = now
        return self._due
