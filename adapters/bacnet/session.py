"""One BACnet device at work: found, subscribed to, polled, and left alone while it is silent."""

from __future__ import annotations

import asyncio
import logging
import math
import time
import zlib
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import NamedTuple

from adapters.bacnet.asking import Asking
from adapters.bacnet.client import BacnetLink, Device, NoAnswer, Notification, Refused
from adapters.bacnet.config import BacnetConfig
from adapters.bacnet.objects import DEVICE, PRESENT_VALUE, SERVICES_SUPPORTED, STATUS_FLAGS, UNITS, ObjectId, Property
from adapters.bacnet.points import BacnetChannel, Seen, addresses, judged
from adapters.bacnet.values import Unreadable, whole
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


class _Kept(NamedTuple):
    """What was last seen of an object, and when it was read (monotonic s; -inf: only told of)."""

    seen: Seen
    read: float


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
        """Why it is silent."""
        self._source, self._instance, self._link = source, device, link
        self._channels, self._table, self._deliver = channels, table, deliver
        self._process = zlib.crc32(source.encode()) % LARGEST_PROCESS + 1
        """The number of its subscriptions."""
        self.rhythm = Rhythm(f"sources.{source} device {device}", table.poll)
        self._device: Device | None = None
        self._at: str | None = None
        """The address that the device was given last, if any."""
        self._asking: Asking | None = None
        self._refresh = 0.0
        self._units: dict[ObjectId, int] = {}
        self._kept: dict[ObjectId, _Kept] = {}
        self._refused: set[ObjectId] = set()
        """Objects that the device did not give away, until they are asked for again."""
        self._subscribed: dict[ObjectId, float] = {}
        """Objects with a subscription, and when it is to be renewed (monotonic s)."""
        self._not_offered: set[ObjectId] = set()

    async def follow(self, phase: float) -> None:
        """Ask for ever, `phase` s after the first time for the second, so that not all devices answer at once; never
        raises for what a device does."""
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
        value = notification.values.get(PRESENT_VALUE)
        if notification.object not in self._subscribed or value is None:
            return False
        before = self._kept.get(notification.object)
        flags = notification.values.get(STATUS_FLAGS, before.seen.flags if before else None)
        seen = Seen(value, flags, self._units.get(notification.object))
        self._kept[notification.object] = _Kept(seen, before.read if before else float("-inf"))
        return True

    def _objects(self) -> list[ObjectId]:
        """The objects of the device that have channels."""
        return [object for device, object in self._channels.points if device == self._instance]

    def _address(self) -> str | None:
        """Where the channels say that the device is."""
        return addresses(self._channels.all()).get(self._instance)

    async def _look(self) -> None:
        """Bring one reading of every channel."""
        if self._device is None or self._asking is None:
            self._at = self._address()
            self._device = await self._link.find(self._instance, self._at)
            self._asking = Asking(self._link, self._device, _OBJECT_OCTETS)
            self._subscribed.clear()
        if time.monotonic() >= self._refresh:
            await self._read_units(self._asking)
            self._refused.clear()
            self._not_offered.clear()
        now = time.monotonic()
        objects = [object for object in self._objects() if object not in self._refused]
        to_read = [
            object
            for object in objects
            if object not in self._subscribed or now >= self._kept[object].read + max(CONFIRM, self._table.poll)
        ]
        if objects and not to_read:
            # What was told counts while the device answers.
            with suppress(Refused):
                await self._link.read_one(self._device, Property(ObjectId(DEVICE, self._instance), SERVICES_SUPPORTED))
        when: dict[ObjectId, float] = {}
        for answered, found in await self._read(self._asking, to_read):
            when |= dict.fromkeys(found, answered)
        told = time.time()
        readings: list[Reading] = []
        for object in objects:
            if object in self._refused:
                readings += self._channels.bad((self._instance, object), Fault.REFUSED_BY_DEVICE)
            elif object in self._kept:
                seen = self._kept[object].seen
                point, judge = (self._instance, object), partial(judged, seen=seen)
                readings += self._channels.readings(point, judge, when.get(object, told), seen.value)
        if readings:
            await self._deliver(Batch(readings, max((told, *when.values()))))
        await self._subscribe(self._device)

    async def _read_units(self, asking: Asking) -> None:
        """Ask for the units of every object; those that have none are of no concern."""
        for answer in await asking.ask(self._objects(), (UNITS,)):
            for what, value in answer.values.items():
                self._units.pop(what.object, None)
                if not isinstance(value, Refused):
                    try:
                        self._units[what.object] = whole(value)
                    except Unreadable:
                        continue
        for object, kept in self._kept.items():
            self._kept[object] = kept._replace(seen=kept.seen._replace(units=self._units.get(object)))
        self._refresh = time.monotonic() + REFRESH

    async def _subscribe(self, device: Device) -> None:
        """Subscribe to what can be subscribed to, and renew what is due; a part of it, so that readings do not wait."""
        lifetime, poll = self._table.lifetime, self._table.poll
        if not device.subscriptions or poll >= CONFIRM:
            return
        objects = self._objects()
        left = max(_SUBSCRIBED_AT_ONCE, math.ceil(len(objects) * poll / (lifetime / 4)))
        allowed = {object for object in objects if all(one.cov for one in self._channels.at((self._instance, object)))}
        self._subscribed = {object: due for object, due in self._subscribed.items() if object in allowed}
        before = len(self._not_offered)
        for object in objects:
            due = self._subscribed.get(object, 0.0)
            left_out = object in self._refused or object in self._not_offered or object not in self._kept
            if left_out or time.monotonic() < due or object not in allowed:
                continue
            if not left:
                break
            left -= 1
            try:
                await self._link.subscribe(device, object, self._process, lifetime)
            except Refused as error:
                self._subscribed.pop(object, None)
                self._not_offered.add(object)
                if len(self._not_offered) == 1 and not before:
                    _log.info(
                        "sources.%s: device %d offers no subscription to %s (%s); what it does not offer is polled",
                        self._source,
                        self._instance,
                        object,
                        error,
                    )
            else:
                self._subscribed[object] = time.monotonic() + lifetime / 2

    async def _read(self, asking: Asking, objects: Sequence[ObjectId]) -> list[tuple[float, list[ObjectId]]]:
        """Read the present values of `objects`; when, and of which there now is one."""
        found = []
        for answer in await asking.ask(objects, (PRESENT_VALUE, STATUS_FLAGS)):
            there = []
            for object in dict.fromkeys(what.object for what in answer.values):
                value, flags = (answer.values[Property(object, kind)] for kind in (PRESENT_VALUE, STATUS_FLAGS))
                if isinstance(value, Refused):
                    self._refused.add(object)
                    again = f"every {REFRESH / 60:.0f} min"
                    self._channels.note_refusal((self._instance, object), str(value), again)
                    continue
                seen = Seen(value, None if isinstance(flags, Refused) else flags, self._units.get(object))
                self._kept[object] = _Kept(seen, time.monotonic())
                self._channels.note_value((self._instance, object))
                there.append(object)
            found.append((answer.time, there))
        return found

    def _note_silence(self, reason: str) -> None:
        if not self.silent:
            _log.warning(
                "sources.%s: device %d is silent: %s; going on with the others", self._source, self._instance, reason
            )
        self.silent, self.reason = True, reason
        # It may be somewhere else when it comes back, and has forgotten its subscriptions.
        self._device = None
