"""Random numbers by position, not by history.

A zone's draws at step k come from a Philox generator keyed by the zone's seed with the step and the stage as counter.
The whole state of the generator is therefore (seed, step), which the checkpoint carries anyway: predicting twice, or
after a restart, gives the same bits.
"""

from __future__ import annotations

from enum import IntEnum

from numpy.random import Generator, Philox


class Stage(IntEnum):
    """What the draws are for; each stage of each step has its own stream."""

    PRIOR = 0
    PREDICT = 1
    UPDATE = 2
    FORECAST = 3


def stream(seed: int, step: int, stage: Stage) -> Generator:
    """The generator of `stage` at `step`; 2^128 draws before it would meet the next one."""
    return Generator(Philox(key=seed, counter=(int(step) << 192) | (int(stage) << 128)))
