"""One BACnet device at work: found, subscribed to, polled, and left alone while it is silent."""

import asyncio
import logging
import math
import time
import zlib
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

from adapters.bacnet.client import BacnetLink, Device, NoAnswer, Notification, Refused
from adapters.bacnet.config import BacnetConfig
from adapters.bacnet.objects import DEVICE, PRESENT_VALUE, SERVICES_SUPPORTED, STATUS_FLAGS, UNITS, ObjectId
from adapters.bacnet.points import BacnetChannel, Seen, addresses, judged
from adapters.bacnet.values import known, whole
from adapters.reading import Batch, Fault, Reading
from adapters.rhythm import Rhythm
from adapters.watched import Channels

LARGEST_PROCESS = 0x3FFFFF

LONGEST_SILENCE = 30.0
"""After this time at the latest a silent device is asked again, in s."""

REFRESH = 600.0
"""After this time objects and subscriptions that a device has refused are asked for again, and its units, in s."""

CONFIRM = 60.0
"""Objects with a subscription are read as well after this time: notifications get lost, and devices go away, in s."""

_SUBSCRIBED_AT_ONCE = 10

_OBJECT_OCTETS = 34
"""What the value and the status of an object take in an answer at most."""

_log = logging.getLogger(__name__)


@dataclass
class Followed:
    """What was last seen of an object with channels, when it was read, and when its subscription is due (monotonic s;
    None without one). `refused`, `not_offered`: it, or a subscription, is left alone until the next refresh."""

    seen: Seen | None = None
    units: int | None = None
    read: float = -math.inf
    renew: float | None = None
    refused: bool = False
    not_offered: bool = False


class Session:
    """A device of a source. `deliver` takes its batches; `silent` is None until it was first tried."""

    def __init__(
        self,
        source: str,
        device: int,
        link: BacnetLink,
        channels: Channels[BacnetChannel],
        table: BacnetConfig,
        deliver: Callable[[Batch], Awaitable[None]],
    ) -> None:
        self.silent: bool | None = None
        self.reason = ""
        self.objects: dict[ObjectId, Followed] = {}
        self.rhythm = Rhythm(f"sources.{source} device {device}", table.poll)
        self._source, self._instance, self._link = source, device, link
        self._channels, self._table, self._deliver = channels, table, deliver
        self._process = zlib.crc32(source.encode()) % LARGEST_PROCESS + 1
        self._device: Device | None = None
        self._at: str | None = None
        """The address that the device was given last, if any."""
        self._refresh = 0.0

    async def follow(self, phase: float) -> None:
        """Ask for ever, first now and then in `phase` s, to spread devices; never raises for what a device does."""
        self.rhythm.begin(phase - self._table.poll)
        pause = 0.0
        while True:
            try:
                await self._look()
            except (NoAnswer, Refused) as error:
                pause = min(2 * pause or self._table.poll, LONGEST_SILENCE)
                self._note_silence(str(error))
                await asyncio.sleep(pause)
                continue
            pause = 0.0
            if self.silent:
                _log.info("sources.%s: device %d answers again", self._source, self._instance)
            self.silent = False
            await self.rhythm.wait()

    def rebound(self) -> None:
        """The channels have changed: look at units and subscriptions again, and where the device is."""
        self._refresh = 0.0
        if self._address() != self._at:
            self._device = None

    def heard(self, notification: Notification) -> bool:
        """Take in what a device tells; whether it was this one, and asked to."""
        if self._device is None or notification.address != self._device.address:
            return False
        followed, value = self.objects.get(notification.object), notification.values.get(PRESENT_VALUE)
        if followed is None or followed.renew is None or value is None:
            return False
        before = None if followed.seen is None else followed.seen.flags
        followed.seen = Seen(value, notification.values.get(STATUS_FLAGS, before), followed.units)
        return True

    def _point(self, object: ObjectId) -> tuple[int, ObjectId]:
        return self._instance, object

    def _address(self) -> str | None:
        return addresses(self._channels.all()).get(self._instance)

    async def _look(self) -> None:
        wanted = [object for device, object in self._channels.points if device == self._instance]
        self.objects = {object: self.objects.get(object) or Followed() for object in wanted}
        if self._device is None:
            self._at = self._address()
            self._device = await self._link.find(self._instance, self._at)
            for followed in self.objects.values():
                followed.renew = None
        device = self._device
        if time.monotonic() >= self._refresh:
            await self._read_units(device)
        now = time.monotonic()
        asked = {object: followed for object, followed in self.objects.items() if not followed.refused}
        confirm = now - max(CONFIRM, self._table.poll)
        to_read = [object for object, one in asked.items() if one.renew is None or one.read <= confirm]
        if asked and not to_read:
            # What was told counts while the device answers.
            with suppress(Refused):
                await self._link.read_one(device, ObjectId(DEVICE, self._instance), SERVICES_SUPPORTED)
        when = await self._read(device, to_read)
        told = time.time()
        readings: list[Reading] = []
        for object, followed in asked.items():
            point, seen = self._point(object), followed.seen
            if followed.refused:
                readings += self._channels.bad(point, Fault.REFUSED_BY_DEVICE)
            elif seen is not None:
                judge = partial(judged, seen=seen)
                readings += self._channels.readings(point, judge, when.get(object, told), seen.value)
        if readings:
            await self._deliver(Batch(readings, max((told, *when.values()))))
        await self._subscribe(device)

    async def _read_units(self, device: Device) -> None:
        """Ask for the units of every object; those that have none are of no concern. What was refused is forgotten."""
        for object, answer in (await self._link.ask(device, [*self.objects], (UNITS,), _OBJECT_OCTETS)).items():
            followed = self.objects[object]
            followed.units = known(whole, answer.values[UNITS])
            followed.refused = followed.not_offered = False
            if followed.seen is not None:
                followed.seen = followed.seen._replace(units=followed.units)
        self._refresh = time.monotonic() + REFRESH

    async def _read(self, device: Device, objects: list[ObjectId]) -> dict[ObjectId, float]:
        """Read the present values of `objects`; of which there now is one, and since when (UTC s)."""
        when: dict[ObjectId, float] = {}
        answers = await self._link.ask(device, objects, (PRESENT_VALUE, STATUS_FLAGS), _OBJECT_OCTETS)
        for object, answer in answers.items():
            followed, point = self.objects[object], self._point(object)
            value, flags = answer.values[PRESENT_VALUE], answer.values[STATUS_FLAGS]
            if isinstance(value, Refused):
                followed.refused = True
                self._channels.note_refusal(point, str(value), f"every {REFRESH / 60:.0f} min")
                continue
            followed.seen = Seen(value, None if isinstance(flags, Refused) else flags, followed.units)
            followed.read = time.monotonic()
            self._channels.note_value(point)
            when[object] = answer.time
        return when

    async def _subscribe(self, device: Device) -> None:
        """Subscribe to what can be subscribed to, and renew what is due; a part of it, so that readings do not wait."""
        lifetime, poll = self._table.lifetime, self._table.poll
        if not device.subscriptions or poll >= CONFIRM:
            return
        left = max(_SUBSCRIBED_AT_ONCE, math.ceil(len(self.objects) * poll / (lifetime / 4)))
        for object, followed in self.objects.items():
            if not all(one.cov for one in self._channels.at(self._point(object))):
                followed.renew = None
                continue
            due = followed.renew is None or time.monotonic() >= followed.renew
            if not (left and due) or followed.refused or followed.not_offered or followed.seen is None:
                continue
            left -= 1
            try:
                await self._link.subscribe(device, object, self._process, lifetime)
                followed.renew = time.monotonic() + lifetime / 2
            except Refused as error:
                if not any(one.not_offered for one in self.objects.values()):
                    say = "sources.%s: device %d offers no subscription to %s (%s); what it does not offer is polled"
                    _log.info(say, self._source, self._instance, object, error)
                followed.renew, followed.not_offered = None, True

    def _note_silence(self, reason: str) -> None:
        if not self.silent:
            say = "sources.%s: device %d is silent: %s; going on with the others"
            _log.warning(say, self._source, self._instance, reason)
        self.silent, self.reason = True, reason
        # It may be somewhere else when it comes back, and has forgotten its subscriptions.
        self._device = None
