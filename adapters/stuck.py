"""Telling a sensor that is stuck from one that measures something steady."""

from __future__ import annotations

from collections.abc import Hashable

from adapters.reading import Quality


class StuckWatch:
    """Watches the raw value of one channel: one that has not changed for `after` s is uncertain, for twice as long bad.

    A sensor that works shows its own noise in the last digit; one whose raw value stays the same to the bit for hours
    has frozen, or its bus has.
    """

    def __init__(self, after: float | None) -> None:
        """`after` None: nothing is ever stuck."""
        self._after = after
        self._since: float | None = None
        self._raw: Hashable = None

    def quality(self, time: float, raw: Hashable) -> Quality:
        """How far `raw`, seen at `time` (s on a clock that is never set), can be believed."""
        if self._since is None or raw != self._raw:
            self._since, self._raw = time, raw
        if self._after is None or time - self._since < self._after:
            return Quality.GOOD
        return Quality.UNCERTAIN if time - self._since < 2 * self._after else Quality.BAD
