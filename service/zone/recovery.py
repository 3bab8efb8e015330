"""When a zone writes its checkpoints, what it begins with, and which of its failures are no sample's fault."""

import asyncio
import logging
import zlib
from collections.abc import Callable

from service.errors import ServiceError
from service.store.checkpoint import Checkpoint
from service.store.journalling import JournalStore

_ENVIRONMENT = (OSError, MemoryError, ImportError, EOFError, ServiceError)
_OF_THE_COMPILER = ("numba", "llvmlite", "_pickle", "pickle")
"""Packages whose errors are those of the compiler and its cache."""

_log = logging.getLogger(__name__)


def is_of_the_environment(error: BaseException) -> bool:
    """Whether `error`, or its cause, is one of disk, memory, threads or compiler: no sample is to blame."""
    if isinstance(error, _ENVIRONMENT) or "can't start new thread" in str(error):
        return True
    if type(error).__module__.partition(".")[0] in _OF_THE_COMPILER:
        return True
    return error.__cause__ is not None and is_of_the_environment(error.__cause__)


async def first_checkpoint(
    store: JournalStore, zone: str, neighbours: Callable[[], Checkpoint | None]
) -> Checkpoint | None:
    """The checkpoint that a `zone` without one begins with if it has no sample yet, on disk before the first one comes;
    None where it begins alone. Without it a crash could let it begin with something else."""
    if await store.run(store.journal.last_sample_time, zone) is not None:
        return None
    checkpoint = await asyncio.to_thread(neighbours)
    if checkpoint is not None:
        await asyncio.to_thread(store.checkpoints.save, zone, checkpoint)
        _log.info("zone '%s' begins with what its neighbours have learned", zone)
    return checkpoint


def next_moment(zone: str, every: float, now: float) -> float:
    """When the next checkpoint of `zone` is due, s on the clock of `now`, where one is written in `every` s: each zone
    has a moment of its own in that time, so that no instant sees those of all zones."""
    moment = zlib.crc32(zone.encode()) / 2**32 * every
    return now + ((moment - now) % every or every)
