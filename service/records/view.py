"""A zone as REST, metrics and the publisher see it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from estimator.arrays import Array
from estimator.network.network import Network
from estimator.statespace.simulate import Simulation
from estimator.types import ParameterSummary
from service.records.fan import Fan
from service.records.history import HistoryRow
from service.records.model import CompactFan, ZoneModel
from service.records.outlook import Outlook, Surroundings
from service.records.series import Series
from service.records.skill import Skill
from service.records.status import ZoneStatus
from service.records.trust import Trust
from service.records.update import Update


class ZoneView(Protocol):
    """One zone, to be read while its worker runs. The methods may raise ServiceError."""

    id: str
    network: Network
    period: float
    """Sampling period in s."""
    estimator: str
    surroundings: Surroundings
    """Limits of what may be planned, neighbours and forecasts of the weather."""

    def status(self) -> ZoneStatus:
        """How the zone is doing now; cheap, and safe from any thread."""

    def latest(self) -> Update | None:
        """The newest update; None before the first sample."""

    async def fan(self, steps: int, levels: Sequence[float], plan: Mapping[str, Sequence[float]] | None) -> Fan | None:
        """The standing forecast with intervals at `levels`, and `steps` more (so `steps` + 1 in all; 0 is allowed).

        `plan` maps input channels to `steps` values each, in the network's unit; value i holds over
        [valid_time + i * period, valid_time + (i + 1) * period). Other inputs are foreseen. None before the first
        sample.
        """

    async def outlook(self, steps: int) -> tuple[Update, Outlook] | None:
        """The newest update, and the inputs of `steps` steps from its forecast on as far as they are foreseen without
        a plan; None where there is no standing forecast. Cheap."""

    async def compact_fan(
        self, update: Update, levels: Sequence[float], rows: Array, scenarios: int
    ) -> CompactFan | None:
        """The forecast from `update` on under the inputs `rows` (h, n_u), with `scenarios` sampled futures; None where
        `update` is no longer the newest. NoModel for scenarios of an estimator without physics."""

    async def room(self, update: Update) -> Simulation | None:
        """The zone's physics from the forecast of `update` on, to be simulated with its neighbours; None where there
        are none, or `update` is no longer the newest."""

    async def model(self, periods: int, count: int) -> ZoneModel | None:
        """State-space matrices at a step of `periods` periods, at most `count` draws; None where there is no standing
        forecast. NoModel for an estimator without physics."""

    def trust(self) -> Trust:
        """How far the zone's forecasts can be relied on now; cheap."""

    async def parameters(self, levels: Sequence[float]) -> ParameterSummary | None:
        """Posterior quantiles at `levels`; None before the first sample."""

    async def skill(self) -> Skill | None:
        """What the zone's forecasts have been worth; None before the first sample."""

    async def history(self, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """The newest `limit` rows with `start` <= time < `end` (UTC seconds; None: open), oldest first."""

    async def series(self, start: int, end: int, points: int) -> Series:
        """The history with `start` <= time < `end` (UTC seconds) in at most `points` buckets, with the inputs."""
