"""One task per source: its batches, split by zone, aligned and accepted; its failures retried."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping, Sequence
from math import inf, isfinite, nextafter

from adapters.errors import SourceConfigError, SourceError
from adapters.reading import Source
from service.routing import Delivery, Router
from service.zone import Zone

FIRST_PAUSE = 1.0
LONGEST_PAUSE = 30.0

TOGETHER = 32
"""Zones that take in their shares in one turn of the event loop: some ms of it at most."""

_log = logging.getLogger(__name__)


async def feed(source: Source, router: Router, zones: Mapping[str, Zone], start: float | None) -> None:
    """Deliver `source` to `zones` from UTC time `start` on until it ends, coming back for ever after failures.

    What a source that is unavailable has delivered stays delivered: it is asked again from its own last clock on.
    """
    pause, position = FIRST_PAUSE, start
    while True:
        try:
            async for batch in source.batches(position):
                await _deliver(router.split(batch), zones)
                if isfinite(batch.now):
                    # Were it asked again, it is for what comes after this.
                    position = nextafter(batch.now, inf)
                    pause = FIRST_PAUSE
            break
        except SourceConfigError as error:
            _log.error("%s; it stays off", error)
            await _tell(zones, router, source.name, str(error))
            return
        except SourceError as error:
            reason = str(error)
        except Exception as error:
            # Whatever else goes wrong in one source must not take the others down.
            reason = f"sources.{source.name} failed: {error!r}"
            _log.debug("%s", reason, exc_info=error)
        _log.error("%s; trying again in %.0f s", reason, pause)
        await _tell(zones, router, source.name, reason)
        await asyncio.sleep(pause)
        pause = min(2 * pause, LONGEST_PAUSE)
    for name in router.zones:
        await zones[name].end(source.name)
    _log.info("source '%s' has come to its end; the zones keep their last forecasts", source.name)


async def _deliver(deliveries: Sequence[Delivery], zones: Mapping[str, Zone]) -> None:
    """Hand every zone its share, some zones at a time, whose samples then share a commit of the journal."""
    for first in range(0, len(deliveries), TOGETHER):
        delivering = [
            zones[share.zone].deliver(share.source, share.readings, share.now)
            for share in deliveries[first : first + TOGETHER]
        ]
        # One zone's failure must not keep the others from their samples.
        for result in await asyncio.gather(*delivering, return_exceptions=True):
            if isinstance(result, BaseException):
                raise result


async def _tell(zones: Mapping[str, Zone], router: Router, source: str, reason: str) -> None:
    for name in router.zones:
        await zones[name].source_failed(source, reason)
