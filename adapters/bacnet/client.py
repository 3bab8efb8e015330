"""The connection to a BACnet/IP network: bacpypes3 behind a few verbs, its errors as ours. It can only read."""

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from bacpypes3.apdu import (
    AbortPDU,
    ErrorRejectAbortNack,
    ReadPropertyMultipleRequest,
    ReadPropertyRequest,
    RejectPDU,
    SubscribeCOVRequest,
    UnconfirmedCOVNotificationRequest,
)
from bacpypes3.basetypes import PropertyIdentifier, PropertyReference, ReadAccessSpecification
from bacpypes3.constructeddata import SequenceOf
from bacpypes3.pdu import Address, IPv4Address
from bacpypes3.primitivedata import ObjectIdentifier

from adapters.bacnet.config import BacnetConfig
from adapters.bacnet.objects import DEVICE, MAX_APDU, SERVICES_SUPPORTED, ObjectId
from adapters.bacnet.stack import ReadingApplication
from adapters.bacnet.values import Unreadable, Value, bits, whole
from adapters.errors import SourceUnavailable

_SMALLEST_APDU, _HEADER_OCTETS = 50, 16
_NO_RESPONSE = 65
_ABORTS_OF_LENGTH = {1, 4, 11}
"""Reasons of aborts that a shorter answer would not have had: buffer overflow, no segmentation, APDU too long."""

_SUBSCRIBE_COV, _READ_PROPERTY_MULTIPLE = 5, 14
"""Bits of protocol-services-supported."""

_APPLICATION = 0
"""The class of the tags of simple values."""

_LOOK = 0.05


class NoAnswer(Exception):
    """The device did not answer; the text says what was tried."""


class Refused(Exception):
    """The device answered that it does not give what was asked for; the text says why."""


class TooLong(Refused):
    """The answer would be longer than the device can send at once."""


class Found(NamedTuple):
    """A device that has told who it is: its instance and where it is."""

    instance: int
    address: Any


@dataclass
class Device:
    """What has to be known of a device to talk to it: octets that an answer may have, and what it offers."""

    instance: int
    address: Any
    longest: int = _SMALLEST_APDU
    multiple: bool = False
    subscriptions: bool = False


class Notification(NamedTuple):
    """What a device tells about an object of its own accord."""

    address: Any
    object: ObjectId
    values: dict[int, Value]


class Answer(NamedTuple):
    """The values of an object by property, or why there is none; and when they came, UTC s."""

    values: Mapping[int, Value | Refused]
    time: float


class BacnetLink:
    """One port on a BACnet network. Made inside the event loop that uses it."""

    def __init__(self, network: BacnetConfig, note: Callable[[str], None], *, beside: bool = False) -> None:
        """`note` takes the kind of whatever comes and cannot be used. `beside`: work from another port where a program
        of this machine, such as the daemon, has the one of `network`."""
        self._network, self._note, self._beside = network, note, beside
        self._application: Any = ReadingApplication(network, note)

    async def open(self) -> None:
        """Open the port, and register with the BBMD if there is one. Raises SourceUnavailable with the remedy."""
        network = self._network
        try:
            await self._application.datagrams.open(broadcasts=network.bbmd is None, beside=self._beside)
        except OSError as error:
            raise SourceUnavailable(
                f"{network.interface} port {network.port} cannot be used ({error.strerror or error}); "
                "check that interface is an address of this machine, and that no other BACnet program has the port"
            ) from error
        if network.bbmd is None:
            return
        foreign = self._application.foreign
        foreign.register(IPv4Address(network.bbmd), max(round(network.ttl), 1))
        end = time.monotonic() + network.timeout * (1 + network.retries)
        while foreign.bbmdRegistrationStatus < 0 and time.monotonic() < end:
            await asyncio.sleep(_LOOK)
        if foreign.bbmdRegistrationStatus != 0:
            what = "does not answer" if foreign.bbmdRegistrationStatus < 0 else "refuses to register foreign devices"
            raise SourceUnavailable(f"the BBMD {network.bbmd} {what}; check bbmd, and that it accepts foreign devices")

    def listen(self, heard: Callable[[Notification], None]) -> None:
        def notified(apdu: UnconfirmedCOVNotificationRequest) -> None:
            try:
                values = {int(item.propertyIdentifier): _value(item.value) for item in apdu.listOfValues}
                heard(Notification(apdu.pduSource, _object(apdu.monitoredObjectIdentifier), values))
            except (Unreadable, TypeError, ValueError):
                self._note("notification")

        self._application.on_notification = notified

    async def who_is(self, seconds: float, lowest: int | None = None, highest: int | None = None) -> list[Found]:
        """Devices with instances `lowest` to `highest` that answer within `seconds`; at once if it is one."""
        answers = await self._application.who_is(lowest, highest, timeout=seconds)
        return [Found(int(answer.iAmDeviceIdentifier[1]), answer.pduSource) for answer in answers]

    async def find(self, instance: int, address: Any = None) -> Device:
        """The device `instance`, at `address` (written, or of a Found) or anywhere. Raises NoAnswer or Refused."""
        if isinstance(address, str):
            where = Address(address if ":" in address else f"{address}:{self._network.port}")
        else:
            where = address or await self._locate(instance)
        device, itself = Device(instance, where), ObjectId(DEVICE, instance)
        try:
            longest = whole(await self.read_one(device, itself, MAX_APDU))
            services = bits(await self.read_one(device, itself, SERVICES_SUPPORTED))
        except Refused as error:
            raise Refused(f"{where} is not device {instance}: {error}") from error
        except Unreadable as error:
            raise Refused(f"what {where} says of itself {error}") from error
        services += [False] * (_READ_PROPERTY_MULTIPLE + 1 - len(services))
        ours = int(self._application.asap.device_object.maxApduLengthAccepted)
        longest = min(max(longest, _SMALLEST_APDU), ours)
        return Device(instance, where, longest, services[_READ_PROPERTY_MULTIPLE], services[_SUBSCRIBE_COV])

    async def _locate(self, instance: int) -> Any:
        for _ in range(1 + self._network.retries):
            found = await self.who_is(self._network.timeout, instance, instance)
            if found:
                return found[0].address
        raise NoAnswer(f"no device {instance} answers within {self._network.timeout:g} s")

    async def read_one(self, device: Device, object: ObjectId, property: int, index: int | None = None) -> Value:
        """A property, or its element `index` (0: how many there are). Raises NoAnswer or Refused."""
        values = await self.read_list(device, object, property, index)
        if len(values) != 1:
            raise Refused("it answers with something else")
        return values[0]

    async def read_list(self, device: Device, object: ObjectId, property: int, index: int | None = None) -> list[Value]:
        """The values of a list or array, or its element `index`. Raises NoAnswer or Refused."""
        request = ReadPropertyRequest(
            objectIdentifier=ObjectIdentifier(object),
            propertyIdentifier=PropertyIdentifier(property),
            destination=device.address,
        )
        if index is not None:
            request.propertyArrayIndex = index
        response = await self._answer(request)
        try:
            return _values(response.propertyValue)
        except (Unreadable, AttributeError) as error:
            raise Refused("it answers with something else") from error

    async def ask(
        self, device: Device, objects: Sequence[ObjectId], properties: Sequence[int], octets: int
    ) -> dict[ObjectId, Answer]:
        """`properties` of every one of `objects`, in as few requests as it takes, and in as many as `device` needs;
        those of one object take `octets` in an answer at most. Raises NoAnswer."""
        answers: dict[ObjectId, Answer] = {}
        begin = 0
        while begin < len(objects):
            together = objects[begin : begin + max((device.longest - _HEADER_OCTETS) // octets, 1)]
            begin += len(together)
            answers |= await self._together(device, together, properties, octets)
        return answers

    async def _together(
        self, device: Device, objects: Sequence[ObjectId], properties: Sequence[int], octets: int
    ) -> dict[ObjectId, Answer]:
        if device.multiple:
            try:
                return await self._multiple(device, objects, properties)
            except Refused as error:
                middle = len(objects) // 2
                if middle:
                    # Too long, or one of them spoils it for all.
                    if isinstance(error, TooLong):
                        device.longest = min(device.longest, _HEADER_OCTETS + middle * octets)
                    first = await self._together(device, objects[:middle], properties, octets)
                    return first | await self._together(device, objects[middle:], properties, octets)
        answers = {}
        for object in objects:
            values: dict[int, Value | Refused] = {}
            for property in properties:
                try:
                    values[property] = await self.read_one(device, object, property)
                except Refused as error:
                    values[property] = error
            answers[object] = Answer(values, time.time())
        return answers

    async def _multiple(
        self, device: Device, objects: Sequence[ObjectId], properties: Sequence[int]
    ) -> dict[ObjectId, Answer]:
        """The same in one request, all of which one answer has to hold. Raises NoAnswer or Refused."""
        references = [PropertyReference(propertyIdentifier=PropertyIdentifier(property)) for property in properties]
        wanted = [
            ReadAccessSpecification(objectIdentifier=ObjectIdentifier(object), listOfPropertyReferences=references)
            for object in objects
        ]
        response = await self._answer(
            ReadPropertyMultipleRequest(
                listOfReadAccessSpecs=SequenceOf(ReadAccessSpecification)(wanted), destination=device.address
            )
        )
        arrived = time.time()
        try:
            found = _results(response)
        except (AttributeError, TypeError, ValueError) as error:
            self._note("apdu")
            raise Refused("it answers with something else") from error
        missing = dict.fromkeys(properties, Refused("it is not in the answer"))
        return {object: Answer(missing | found.get(object, {}), arrived) for object in objects}

    async def subscribe(self, device: Device, object: ObjectId, process: int, lifetime: float) -> None:
        """Be told of changes of `object` for `lifetime` s. Raises NoAnswer or Refused."""
        await self._answer(
            SubscribeCOVRequest(
                subscriberProcessIdentifier=process,
                monitoredObjectIdentifier=ObjectIdentifier(object),
                issueConfirmedNotifications=False,
                lifetime=max(round(lifetime), 1),
                destination=device.address,
            )
        )

    async def close(self) -> None:
        """Close the port; safe to call twice."""
        await self._application.end()

    async def _answer(self, request: Any) -> Any:
        timeout, silence = self._network.timeout, f"no answer from {request.pduDestination} within"
        try:
            # The library gives up by itself, but for what it loses on the way.
            async with asyncio.timeout(timeout * (1 + self._network.retries) + 1.0):
                return await self._application.request(request)
        except TimeoutError:
            raise NoAnswer(f"{silence} {timeout:g} s") from None
        except ErrorRejectAbortNack as error:
            if isinstance(error, AbortPDU) and error.apduAbortRejectReason == _NO_RESPONSE:
                raise NoAnswer(f"{silence} {timeout:g} s") from None
            raise _refusal(error) from None


def _refusal(error: ErrorRejectAbortNack) -> Refused:
    if isinstance(error, AbortPDU):
        text = f"abort {error.apduAbortRejectReason}"
        return TooLong(text) if int(error.apduAbortRejectReason) in _ABORTS_OF_LENGTH else Refused(text)
    if isinstance(error, RejectPDU):
        return Refused(f"reject {error.apduAbortRejectReason}")
    return Refused(f"{getattr(error, 'errorClass', '?')} error {getattr(error, 'errorCode', '?')}")


def _object(identifier: Any) -> ObjectId:
    return ObjectId(int(identifier[0]), int(identifier[1]))


def _results(response: Any) -> dict[ObjectId, dict[int, Value | Refused]]:
    found: dict[ObjectId, dict[int, Value | Refused]] = {}
    for result in response.listOfReadAccessResults:
        values = found.setdefault(_object(result.objectIdentifier), {})
        for element in result.listOfResults or ():
            error, property = element.readResult.propertyAccessError, int(element.propertyIdentifier)
            if error is not None:
                values[property] = Refused(f"{error.errorClass} error {error.errorCode}")
                continue
            try:
                values[property] = _value(element.readResult.propertyValue)
            except Unreadable as unreadable:
                values[property] = Refused(f"it {unreadable}")
    return found


def _value(value: Any) -> Value:
    """The one simple value in `value`, an Any of bacpypes3. Raises Unreadable."""
    values = _values(value)
    if len(values) != 1:
        raise Unreadable("is no single value")
    return values[0]


def _values(value: Any) -> list[Value]:
    """The simple values in `value`, an Any of bacpypes3. Raises Unreadable."""
    tags = [] if value is None or value.tagList is None else list(value.tagList.tagList)
    # Where they stand in a context of their own, its opening and closing tags are around them.
    inside = tags[1:-1] if tags and int(tags[0].tag_class) != _APPLICATION else tags
    return [decoded(tag) for tag in inside]


def decoded(tag: Any) -> Value:
    """The value of a tag of bacpypes3. Raises Unreadable."""
    if int(tag.tag_class) != _APPLICATION:
        raise Unreadable("is no simple value")
    try:
        value: Value | None = tag.app_to_object()
    except Exception as error:
        # Whatever a decoder of the library stumbles over, the value is to blame.
        raise Unreadable("cannot be decoded") from error
    if value is None:
        raise Unreadable("has a type that BACnet does not have")
    return value
