"""The rhythm of polling: when the next poll is due, and whether one took too long."""

from __future__ import annotations


class Rhythm:
    """Polls every `every` s. They keep their rhythm; those that were missed are not made up for."""

    def __init__(self, every: float, now: float) -> None:
        """The first poll is due `now` (s on a clock that is never set)."""
        self._every, self._due = every, now
        self.overrun = 0.0
        """How many s the last poll took, if the next one begins later than it should have by a whole `every` or more;
        otherwise 0."""

    def next(self, now: float) -> float:
        """When the poll after the one that ends `now` is due."""
        began, self._due = self._due, self._due + self._every
        if now < self._due + self._every:
            self._due, self.overrun = max(self._due, now), 0.0
        else:
            self._due, self.overrun = now, now - began
        return self._due
