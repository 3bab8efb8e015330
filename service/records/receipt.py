"""What became of readings that somebody gave a zone and waits to hear of."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

from adapters.reading import Fault


class Receipt(NamedTuple):
    """Counts of readings.

    `accepted` ones are in the journal and will be in the sample of their interval, whatever happens to this process.
    `repeated` ones were accepted before. `refused` are counted by fault. `begun` are first counts of counters.
    """

    accepted: int
    repeated: int
    refused: Counter[Fault]
    begun: int = 0

    def plus(self, other: Receipt) -> Receipt:
        """Both together."""
        return Receipt(
            self.accepted + other.accepted,
            self.repeated + other.repeated,
            self.refused + other.refused,
            self.begun + other.begun,
        )


NOTHING = Receipt(0, 0, Counter())
