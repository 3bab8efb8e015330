"""A zone as REST, metrics and the publisher see it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from estimator.network import Network
from estimator.types import ParameterSummary
from service.journal import HistoryRow
from service.records import InputUsed, OutputForecast, Update

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
    """All channels of the network, also those that never had a good reading."""
    overruns: int = 0
    """Forecasts since the start that were published after the next sample was due."""
    delay: float | None = None
    """How long after its sample the newest forecast was published, s; None before the first since the start."""


class FanStep(NamedTuple):
    """The forecast of every output at `valid_time`, UTC seconds."""

    valid_time: int
    outputs: tuple[OutputForecast, ...]


class Fan(NamedTuple):
    """A forecast over several steps; `steps[0]` is the standing one-step forecast of `update`, from which it starts."""

    sample_time: int
    issue_time: int
    steps: tuple[FanStep, ...]
    inputs: tuple[InputUsed, ...]
    update: Update


class ZoneView(Protocol):
    """One zone, to be read while its worker runs. The methods may raise ServiceError."""

    id: str
    network: Network
    period: float
    """Sampling period in s."""
    estimator: str

    def status(self) -> ZoneStatus:
        """How the zone is doing now; cheap, and safe from any thread."""

    def latest(self) -> Update | None:
        """The newest update; None before the first sample."""

    async def fan(self, steps: int, levels: Sequence[float], plan: Mapping[str, Sequence[float]] | None) -> Fan | None:
        """The standing forecast with intervals at `levels`, and `steps` more (so `steps` + 1 in all; 0 is allowed).

        `plan` maps input channels to `steps` values each, in the network's unit; value i holds over
        [valid_time + i * period, valid_time + (i + 1) * period). Other inputs are held. None before the first sample.
        """

    async def parameters(self, levels: Sequence[float]) -> ParameterSummary | None:
        """Posterior quantiles at `levels`; None before the first sample."""

    async def history(self, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """The newest `limit` rows with `start` <= time < `end` (UTC seconds; None: open), oldest first."""
