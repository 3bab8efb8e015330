"""A zone as REST, metrics and the publisher see it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from estimator.network.network import Network
from estimator.types import ParameterSummary
from service.records.fan import Fan
from service.records.history import HistoryRow
from service.records.skill import Skill
from service.records.status import ZoneStatus
from service.records.update import Update


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

    async def skill(self) -> Skill | None:
        """What the zone's forecasts have been worth; None before the first sample."""

    async def history(self, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """The newest `limit` rows with `start` <= time < `end` (UTC seconds; None: open), oldest first."""
