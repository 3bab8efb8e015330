"""Whether a zone keeps up with its telemetry: how late its forecasts are, and how often too late."""

import logging
import time
from math import inf

from adapters.watched import Seldom

_log = logging.getLogger(__name__)


class Timeliness:
    """Watches one zone, in monotonic s, safe from any thread. The delay of a forecast counts from when its sample was
    accepted to when it was published; one that is longer than from one sample to the next is an overrun."""

    def __init__(self, zone: str) -> None:
        self.overruns = 0
        self.delay: float | None = None
        """Of the newest forecast; None before the first."""
        self.patience = inf
        """Real time from one sample to the next, in s; infinite for a recording that is played as fast as possible."""
        self._zone = zone
        self._since: float | None = None
        self._seldom = Seldom()
        self._unsaid = 0

    def begin(self, accepted: float) -> None:
        """The step over a sample that was accepted then has begun."""
        self._since = accepted

    def rest(self) -> None:
        """Nothing is being stepped over."""
        self._since = None

    def published(self) -> None:
        """The forecast that came of the sample is out."""
        if self._since is None:
            return
        self.delay = time.monotonic() - self._since
        if self.delay > self.patience:
            self.overruns += 1
            self._unsaid += 1
            if self._seldom("late"):
                say = (
                    "zone '%s': a forecast came %.1f s after its sample, and samples come every %g s; %d late since "
                    "this was last said, %d in all"
                )
                _log.warning(say, self._zone, self.delay, self.patience, self._unsaid, self.overruns)
                self._unsaid = 0

    def lag(self, waiting_since: float | None) -> str | None:
        """Why the newest forecast is too old, or None. `waiting_since`: when the next sample was accepted."""
        since = waiting_since if self._since is None else self._since
        late = 0.0 if since is None else time.monotonic() - since
        if late <= self.patience:
            return None
        # Roughly: whoever tells how a zone is doing tells it again when that changes.
        about = round(late, 1 if late < 10.0 else -1)
        return (
            f"its estimator is {about:g} s behind its telemetry, of which a sample comes every {self.patience:g} s; "
            "take fewer particles, a longer period or a faster machine"
        )
