"""The connection to a BACnet/IP network: bacpypes3 behind a few verbs, its errors as ours. It can only read."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from bacpypes3.apdu import (
    AbortPDU,
    ErrorPDU,
    ErrorRejectAbortNack,
    IAmRequest,
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
from adapters.bacnet.objects import DEVICE, MAX_APDU, SERVICES_SUPPORTED, ObjectId, Property
from adapters.bacnet.stack import Stack
from adapters.bacnet.values import Unreadable, Value, bits, whole
from adapters.errors import SourceUnavailable

_SMALLEST_APDU = 50
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
    """A device that has told who it is: its instance, where it is, and the number of its maker."""

    instance: int
    address: Any
    vendor: int


class Device(NamedTuple):
    """What has to be known of a device to talk to it: octets that an answer may have, and what it offers."""

    instance: int
    address: Any
    longest: int
    multiple: bool
    subscriptions: bool


class Notification(NamedTuple):
    """What a device tells about an object of its own accord."""

    address: Any
    process: int
    object: ObjectId
    values: dict[int, Value]


class Answer(NamedTuple):
    """Values by property, or why there is none; and when they came, UTC s."""

    values: dict[Property, Value | Refused]
    time: float


class BacnetLink:
    """One port on a BACnet network. Made inside the event loop that uses it."""

    def __init__(self, network: BacnetConfig, note: Callable[[str], None], *, beside: bool = False) -> None:
        """`note` takes the kind of whatever comes and cannot be used. `beside`: work from another port where a program
        of this machine, such as the daemon, has the one of `network`."""
        self._beside = beside
        self._network, self._note = network, note
        interface = network.interface if "/" in network.interface else f"{network.interface}/32"
        address = IPv4Address(f"{interface}:{network.port}")
        self._stack = Stack(address, network.timeout, network.retries, note, foreign=network.bbmd is not None)
        self._request: Callable[[Any], Any] = self._stack.application.request
        self._who_is: Callable[..., Any] = self._stack.application.who_is

    async def open(self) -> None:
        """Open the port, and register with the BBMD if there is one. Raises SourceUnavailable with the remedy."""
        try:
            await self._stack.datagrams.open(broadcasts=self._network.bbmd is None, beside=self._beside)
        except OSError as error:
            raise SourceUnavailable(
                f"{self._network.interface} port {self._network.port} cannot be used ({error.strerror or error}); "
                "check that interface is an address of this machine, and that no other BACnet program has the port"
            ) from error
        if self._network.bbmd is not None:
            await self._register(self._network.bbmd)

    async def _register(self, bbmd: str) -> None:
        foreign = self._stack.foreign
        assert foreign is not None
        foreign.register(IPv4Address(bbmd), max(round(self._network.ttl), 1))
        end = time.monotonic() + self._network.timeout * (1 + self._network.retries)
        while foreign.bbmdRegistrationStatus < 0 and time.monotonic() < end:
            await asyncio.sleep(_LOOK)
        if foreign.bbmdRegistrationStatus != 0:
            what = "does not answer" if foreign.bbmdRegistrationStatus < 0 else "refuses to register foreign devices"
            raise SourceUnavailable(f"the BBMD {bbmd} {what}; check bbmd, and that it accepts foreign devices")

    def listen(self, heard: Callable[[Notification], None]) -> None:
        """Let `heard` know what subscriptions bring."""

        def notified(apdu: UnconfirmedCOVNotificationRequest) -> None:
            identifier = apdu.monitoredObjectIdentifier
            values = {int(item.propertyIdentifier): _value(item.value) for item in apdu.listOfValues}
            object = ObjectId(int(identifier[0]), int(identifier[1]))
            heard(Notification(apdu.pduSource, int(apdu.subscriberProcessIdentifier), object, values))

        def counted(apdu: UnconfirmedCOVNotificationRequest) -> None:
            try:
                notified(apdu)
            except (Unreadable, TypeError, ValueError):
                self._note("notification")

        self._stack.application.on_notification = counted

    async def who_is(self, seconds: float, lowest: int | None = None, highest: int | None = None) -> list[Found]:
        """The devices with instances from `lowest` to `highest` that answer within `seconds`; at once if one is asked
        for."""
        answers: list[IAmRequest] = await self._who_is(lowest, highest, timeout=seconds)
        return [_found(answer) for answer in answers]

    async def find(self, instance: int, address: Any = None) -> Device:
        """The device `instance`, at `address` (as people write it, or of a Found) or wherever it is. Raises NoAnswer or
        Refused."""
        if isinstance(address, str):
            where = Address(address if ":" in address else f"{address}:{self._network.port}")
        else:
            where = address or await self._locate(instance)
        device = ObjectId(DEVICE, instance)
        known = Device(instance, where, _SMALLEST_APDU, False, False)
        try:
            longest = whole(await self.read_one(known, Property(device, MAX_APDU)))
            services = bits(await self.read_one(known, Property(device, SERVICES_SUPPORTED)))
        except Refused as error:
            raise Refused(f"{where} is not device {instance}: {error}") from error
        except Unreadable as error:
            raise Refused(f"what {where} says of itself {error}") from error
        services += [False] * (_READ_PROPERTY_MULTIPLE + 1 - len(services))
        return known._replace(
            longest=min(max(longest, _SMALLEST_APDU), self._longest),
            multiple=services[_READ_PROPERTY_MULTIPLE],
            subscriptions=services[_SUBSCRIBE_COV],
        )

    @property
    def _longest(self) -> int:
        return int(self._stack.application.asap.device_object.maxApduLengthAccepted)

    async def _locate(self, instance: int) -> Any:
        for _ in range(1 + self._network.retries):
            found = await self.who_is(self._network.timeout, instance, instance)
            if found:
                return found[0].address
        raise NoAnswer(f"no device {instance} answers within {self._network.timeout:g} s")

    async def read_one(self, device: Device, what: Property, index: int | None = None) -> Value:
        """The property `what`, or its element `index` (0: how many there are). Raises NoAnswer or Refused."""
        values = await self.read_list(device, what, index)
        if len(values) != 1:
            raise Refused("it answers with something else")
        return values[0]

    async def read_list(self, device: Device, what: Property, index: int | None = None) -> list[Value]:
        """The values of the list or array `what`, or its element `index`. Raises NoAnswer or Refused."""
        request = ReadPropertyRequest(
            objectIdentifier=ObjectIdentifier(what.object),
            propertyIdentifier=PropertyIdentifier(what.property),
            destination=device.address,
        )
        if index is not None:
            request.propertyArrayIndex = index
        response = await self._answer(request)
        try:
            return _values(response.propertyValue)
        except (Unreadable, AttributeError) as error:
            raise Refused("it answers with something else") from error

    async def read(self, device: Device, wanted: Sequence[Property]) -> Answer:
        """The properties `wanted` in one request, all of which one answer has to hold. Raises NoAnswer or Refused."""
        request = ReadPropertyMultipleRequest(
            listOfReadAccessSpecs=SequenceOf(ReadAccessSpecification)(
                [
                    ReadAccessSpecification(
                        objectIdentifier=ObjectIdentifier(object),
                        listOfPropertyReferences=[
                            PropertyReference(propertyIdentifier=PropertyIdentifier(item.property))
                            for item in wanted
                            if item.object == object
                        ],
                    )
                    for object in dict.fromkeys(item.object for item in wanted)
                ]
            ),
            destination=device.address,
        )
        response = await self._answer(request)
        arrived = time.time()
        try:
            return Answer(_results(response), arrived)
        except (AttributeError, TypeError, ValueError) as error:
            self._note("apdu")
            raise Refused("it answers with something else") from error

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
        await self._stack.close()

    async def _answer(self, request: Any) -> Any:
        network = self._network
        try:
            # The library gives up by itself, but for what it loses on the way.
            async with asyncio.timeout(network.timeout * (1 + network.retries) + 1.0):
                return await self._request(request)
        except TimeoutError:
            raise NoAnswer(f"no answer from {request.pduDestination} within {network.timeout:g} s") from None
        except ErrorRejectAbortNack as error:
            raise _translated(error, request.pduDestination, network.timeout) from None


def _translated(error: ErrorRejectAbortNack, address: Any, timeout: float) -> NoAnswer | Refused:
    if isinstance(error, AbortPDU):
        if error.apduAbortRejectReason == _NO_RESPONSE:
            return NoAnswer(f"no answer from {address} within {timeout:g} s")
        text = f"abort {error.apduAbortRejectReason}"
        return TooLong(text) if int(error.apduAbortRejectReason) in _ABORTS_OF_LENGTH else Refused(text)
    if isinstance(error, RejectPDU):
        return Refused(f"reject {error.apduAbortRejectReason}")
    assert isinstance(error, ErrorPDU)
    return Refused(f"{getattr(error, 'errorClass', '?')} error {getattr(error, 'errorCode', '?')}")


def _found(answer: IAmRequest) -> Found:
    return Found(int(answer.iAmDeviceIdentifier[1]), answer.pduSource, int(answer.vendorID))


def _results(response: Any) -> dict[Property, Value | Refused]:
    values: dict[Property, Value | Refused] = {}
    for result in response.listOfReadAccessResults:
        identifier = result.objectIdentifier
        object = ObjectId(int(identifier[0]), int(identifier[1]))
        for element in result.listOfResults or ():
            error = element.readResult.propertyAccessError
            what = Property(object, int(element.propertyIdentifier))
            if error is not None:
                values[what] = Refused(f"{error.errorClass} error {error.errorCode}")
                continue
            try:
                values[what] = _value(element.readResult.propertyValue)
            except Unreadable as unreadable:
                values[what] = Refused(f"it {unreadable}")
    return values


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
