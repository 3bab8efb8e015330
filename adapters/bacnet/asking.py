"""Reading many properties of a device in as few requests as it takes, and in as many as it needs."""

from __future__ import annotations

import time
from collections.abc import Sequence

from adapters.bacnet.client import Answer, BacnetLink, Device, Refused, TooLong
from adapters.bacnet.objects import ObjectId, Property

_HEADER_OCTETS = 16


class Asking:
    """Requests to one device. `octets` is what the properties of an object take in an answer at most."""

    def __init__(self, link: BacnetLink, device: Device, octets: int) -> None:
        self._link, self._device = link, device
        self._at_once = max((device.longest - _HEADER_OCTETS) // octets, 1)
        """How many objects are read in one request."""

    async def ask(self, objects: Sequence[ObjectId], properties: Sequence[int]) -> list[Answer]:
        """`properties` of every one of `objects`; each has a value or the reason why there is none. Raises NoAnswer."""
        answers: list[Answer] = []
        begin = 0
        while begin < len(objects):
            together = objects[begin : begin + self._at_once]
            begin += len(together)
            answers += await self._together(together, properties)
        return answers

    async def _together(self, objects: Sequence[ObjectId], properties: Sequence[int]) -> list[Answer]:
        wanted = [Property(object, kind) for object in objects for kind in properties]
        if self._device.multiple:
            try:
                answer = await self._link.read(self._device, wanted)
            except Refused as error:
                if len(objects) > 1:
                    # Too long, or one of them spoils it for all.
                    middle = len(objects) // 2
                    if isinstance(error, TooLong):
                        self._at_once = max(min(self._at_once, middle), 1)
                    first = await self._together(objects[:middle], properties)
                    return first + await self._together(objects[middle:], properties)
            else:
                missing = Refused("it is not in the answer")
                return [Answer({what: answer.values.get(what, missing) for what in wanted}, answer.time)]
        alone = Answer({}, time.time())
        for what in wanted:
            try:
                alone.values[what] = await self._link.read_one(self._device, what)
            except Refused as error:
                alone.values[what] = error
        return [alone._replace(time=time.time())]
