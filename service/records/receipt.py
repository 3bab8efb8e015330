"""What became of readings that somebody gave a zone, or posted, and waits to hear of."""

from collections import Counter
from typing import Annotated, Self

from pydantic import PlainSerializer, WithJsonSchema

from adapters.reading import Fault
from service.records.record import record, shown

Refused = Annotated[
    Counter[Fault],
    PlainSerializer(lambda counts: {str(fault): count for fault, count in sorted(counts.items())}),
    WithJsonSchema({"additionalProperties": {"type": "integer"}, "type": "object"}),
]


@record
class Receipt:
    """What became of posted readings; those that are accepted are on disk."""

    accepted: int = shown("in the journal; they will be in the samples of their intervals")
    repeated: int = shown("accepted before: the same channel and time")
    begun: int = shown("counts of counters from which there is no power yet", key="first_counts")
    refused: Refused = shown("by fault; they are also counted in the status of the zone")
    unknown: int = shown("values that no channel asks for", default=0)
    unknown_names: tuple[str, ...] = shown("what some of these are called", default=())

    def plus(self, other: Self) -> "Receipt":
        """Both together, of what channels ask for."""
        return Receipt(
            self.accepted + other.accepted,
            self.repeated + other.repeated,
            self.begun + other.begun,
            self.refused + other.refused,
        )


NOTHING = Receipt(0, 0, 0, Counter())
