"""What a live zone does when the wall clock was set back by more than can be waited out.

The samples that lie ahead of the clock were dated by one that was wrong. They have been learned from, and that is kept;
but time must go on from now, and nothing in the journal may be overwritten. So they are set aside, and the zone goes on
with a new segment.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from service.store.checkpoint import Checkpoint
from service.store.store import Store
from service.zone.clock import MOST_SET_ASIDE
from service.zone.intake import ZoneIntake
from service.zone.worker import ZoneWorker

WHY = "the clock of this machine was set back; waiting for the next sample"

_log = logging.getLogger(__name__)


async def set_back(
    zone: str, checkpoint: Callable[[], Checkpoint | None], worker: ZoneWorker, intake: ZoneIntake, store: Store
) -> bool:
    """Set `zone`, whose state `checkpoint` takes, back to the present time; whether that was done.

    It is not if more than MOST_SET_ASIDE would be set aside: then it is the clock that is wrong. Nobody may use the
    worker meanwhile. Raises ServiceError, and then the zone has to be restored.
    """
    async with intake.accepting:
        now = intake.clock.wall()
        if intake.mailbox.waiting_since is not None or not intake.is_ahead(now):
            return False
        last = intake.aligned.last_before(now)
        ahead = await store.samples_ahead(zone, last)
        if ahead * worker.period > MOST_SET_ASIDE:
            _log.error(
                "zone '%s': %d samples lie ahead of the clock of this machine, too many to set aside; set the clock, "
                "or give the zone's state up with --reset",
                zone,
                ahead,
            )
            return False
        before = checkpoint()
        worker.set_back(last, WHY)
        await store.set_back(zone, before, checkpoint(), last)
        intake.aligned.set_back(now)
    _log.warning(
        "zone '%s': the clock was set back; %d samples that lie ahead of it were set aside, and a new segment begins "
        "with the next sample",
        zone,
        ahead,
    )
    return True
