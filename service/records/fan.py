"""A forecast over several steps."""

from __future__ import annotations

from typing import NamedTuple

from service.records.outlook import InputOrigin
from service.records.update import InputUsed, OutputForecast, Update


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
    origins: tuple[InputOrigin, ...] = ()
    """Where the inputs of the later steps come from."""
