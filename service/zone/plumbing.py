"""What all zones of the daemon share."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import NamedTuple, Protocol

from service.publish.metrics import Metrics
from service.records.status import ZoneStatus
from service.records.update import Update
from service.store.store import Store
from service.zone.clock import Clock


class Announcer(Protocol):
    """Where updates and states of zones are announced, called from worker threads; may raise ServiceError."""

    def publish(self, zone: str, update: Update, status: ZoneStatus) -> None:
        """A sample was assimilated."""

    def publish_status(self, zone: str, status: ZoneStatus, update: Update | None = None) -> None:
        """A zone changed without a new update; `update` is its latest one."""


class Plumbing(NamedTuple):
    """What all zones share."""

    store: Store
    pool: Executor
    """Runs the estimator steps."""
    asking: Executor
    """Runs what REST asks for, so that no question keeps a zone waiting."""
    stopping: threading.Event
    """Set when the daemon begins to stop."""
    metrics: Metrics
    announcers: Sequence[Announcer]
    checkpoint_every: float
    """Wall-clock s between two checkpoints of a zone."""
    clock: Clock = Clock()
