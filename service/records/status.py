"""How a zone is doing."""

from collections.abc import Mapping
from typing import NamedTuple, Self

from estimator.diagnosis.finding import Diagnosis
from service.records.trust import Trust, untrusted
from service.records.update import Update

STATES = ("waiting", "running", "stalled", "failed")
"""Every state of a zone: no sample yet; fed and fresh; telemetry missing or late; failed and to be retried."""


class ZoneStatus(NamedTuple):
    """How a zone is doing. Times are UTC seconds.

    `state` is one of STATES and decides whether the zone counts as fed and fresh; `reason` is one sentence; while
    running it is empty, or says which live source does not deliver. `last_good` maps a channel to the time of its last
    good reading; `faults` counts bad readings by kind. `now` is the clock that ages count from: a recording's own
    clock, or None for the wall clock.
    """

    state: str
    reason: str
    last_sample_time: int | None
    samples: int
    segment: int
    faults: Mapping[str, int]
    last_good: Mapping[str, float]
    now: float | None = None
    channels: tuple[str, ...] = ()
    """All channels of the network, also those that never had a good reading, and the set-point if one is configured."""
    overruns: int = 0
    """Forecasts since the start that were published after the next sample was due."""
    delay: float | None = None
    """How long after its sample the newest forecast was published, s; None before the first since the start."""
    diagnosis: Diagnosis = Diagnosis()
    """What the zone's model does not know, as of the newest diagnosis."""
    writers: Mapping[str, str] = {}
    """Who brought the newest reading of a channel since the start."""


class ZoneState(NamedTuple):
    """A zone as routes, sinks, metrics and the page read it, all at one moment."""

    status: ZoneStatus
    update: Update | None
    """The newest; None before the first sample."""
    trust: Trust
    """How far its forecasts can be relied on."""

    @classmethod
    def of(cls, status: ZoneStatus, update: Update | None, trust: Trust) -> Self:
        """The same with `trust` by its worker, which does not know of what keeps a zone from vouching for anything."""
        if status.state in ("stalled", "failed"):
            trust = untrusted(trust, f"the zone is {status.state}: {status.reason}")
        return cls(status, update, trust)


class Busy(NamedTuple):
    """Samples of a zone that wait or are under way, and how many were finished so far."""

    waiting: int
    finished: int
