"""The clock of this machine, and when to believe it: a wall clock can be wrong (without a battery it starts in 1970 or
2000) or set, and goes on while the machine sleeps. The steady clock is never set."""

import time
from collections.abc import Callable
from typing import NamedTuple

from adapters.fields.times import written_time

PLAUSIBLE = 1_735_689_600.0
"""2025-01-01T00:00:00Z in UTC s. There is no Thermogate of that age: a clock before it has not been set."""
WAITED_OUT = 60.0
"""A clock that is no more than this, or one period, behind the newest sample is waited for, in s."""
SETTLING = 30.0
"""How long a clock has to stay behind before a zone goes back with it, in s: at a start it may be set several times."""
MOST_SET_ASIDE = 7 * 86_400.0
"""Samples of so many s at most are set aside for a clock that was set back. If it were more, the clock is wrong."""


class Clock(NamedTuple):
    """Where the time comes from; tests have clocks of their own."""

    wall: Callable[[], float] = time.time
    """UTC s since 1970, as far as this machine knows."""
    steady: Callable[[], float] = time.monotonic
    """s on a clock that is never set."""


def implausible(now: float) -> str | None:
    """Why wall-clock time `now` cannot be right, or None."""
    if now >= PLAUSIBLE:
        return None
    return f"the clock of this machine says {written_time(now)} and was never set; readings are refused until it is"
