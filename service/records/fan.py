"""A forecast over several steps, as columns."""

from typing import Literal, NamedTuple

from service.records.outlook import InputOrigin
from service.records.record import Matrix, Vector, constant, record, shown
from service.records.update import Update


@record
class CompactOutputPayload:
    """The forecast of one output over all steps: arrays, the first entry of which is for valid_time."""

    # Shapes: (h + 1,), of bounds (L, h + 1), of scenarios (K, h + 1); K is 0 where none were asked for.
    output: str
    unit: Literal["degC"] = constant("degC")
    mean: Vector
    median: Vector
    sd: Vector = shown("K, the sensor's noise included")
    lower: Matrix = shown("by level and then by step")
    upper: Matrix
    scenarios: Matrix = shown("sampled futures, all equally likely")


class Fan(NamedTuple):
    """The forecast of one zone: columns from the published one-step forecast of `update` on, one period apart."""

    update: Update
    levels: tuple[float, ...]
    """(L,): of the intervals."""
    outputs: tuple[CompactOutputPayload, ...]
    origins: tuple[InputOrigin, ...]
    """Where the inputs of the later steps come from."""
