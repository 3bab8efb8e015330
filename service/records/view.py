"""A zone as REST, metrics and the publisher see it."""

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from estimator.network.network import Network
from service.records.history import HistoryRow
from service.records.outlook import Surroundings, Weather
from service.records.series import Series
from service.records.status import ZoneState

Answer = TypeVar("Answer")
Answered = TypeVar("Answered", covariant=True)


class Question(Protocol[Answered]):
    """What can be asked of a zone that its worker has to compute. It changes nothing, and may travel to a shard."""

    def __call__(self, worker: Any, weather: Weather, given_up: Callable[[], bool]) -> Answered:
        """The answer of a `service.zone.worker.ZoneWorker`, which foresees inputs with the forecasts of `weather`.

        `given_up` says whether nobody waits for the answer any more: ServiceError then."""


class ZoneView(Protocol):
    """One zone, to be read while its worker runs. The methods may raise ServiceError."""

    id: str
    network: Network
    period: float
    """Sampling period in s."""
    estimator: str
    surroundings: Surroundings
    """Limits of what may be planned, neighbours and forecasts of the weather."""

    def now(self) -> ZoneState:
        """What is known of the zone now; cheap, and safe from any thread."""

    async def ask(self, question: Question[Answer]) -> Answer:
        """The answer to `question`, from the state after the newest update. It is computed in turn with the questions
        of other clients, and given up when the client of this task has gone."""

    async def history(self, start: int | None, end: int | None, limit: int) -> list[HistoryRow]:
        """The newest `limit` rows with `start` <= time < `end` (UTC seconds; None: open), oldest first."""

    async def series(self, start: int, end: int, points: int) -> Series:
        """The history with `start` <= time < `end` (UTC seconds) in at most `points` buckets, with the inputs."""
