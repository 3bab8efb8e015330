"""What all zones of the daemon share."""

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

from service.publish.metrics import Metrics
from service.publish.sinks import Sink
from service.records.outlook import WeatherBook
from service.store.journalling import JournalStore
from service.zone.clock import Clock
from service.zone.questions import Questions


class Plumbing(NamedTuple):
    """What all zones share."""

    site: str
    store: JournalStore
    pool: Executor
    """Runs the estimator steps."""
    asking: Questions
    """Runs what REST asks for, so that no question keeps a zone waiting."""
    stopping: threading.Event
    """Set when the daemon begins to stop."""
    metrics: Metrics
    sinks: Sequence[Sink]
    """Where zones announce what they know, from the estimator's threads; the metrics are one of them."""
    checkpoint_every: float
    """Wall-clock s between two checkpoints of a zone."""
    clock: Clock = Clock()
    stepping: Callable[[str, int], AbstractContextManager[None]] = lambda zone, time: nullcontext()
    """Surrounds each step of a zone with the sample at a time (UTC s), in the estimator's threads."""
    weather: WeatherBook = WeatherBook()
    """What forecasts of the weather say."""
