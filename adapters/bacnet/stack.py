"""bacpypes3's stack with the services of a client that only reads, on sockets whose failures are seen.

What bacpypes3 would do with everything that comes from the network, from writing to its own objects to falling silent
on command, is left out. What cannot be decoded is counted by kind.
"""

from __future__ import annotations

import asyncio
import errno
import logging
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from bacpypes3.apdu import (
    APDU,
    APCISequence,
    ComplexAckPDU,
    ConfirmedRequestPDU,
    Error,
    ErrorPDU,
    IAmRequest,
    ReadPropertyMultipleRequest,
    ReadPropertyRequest,
    RejectPDU,
    SimpleAckPDU,
    SubscribeCOVRequest,
    UnconfirmedCOVNotificationRequest,
    UnconfirmedRequestPDU,
    WhoIsRequest,
)
from bacpypes3.app import Application
from bacpypes3.appservice import ApplicationServiceAccessPoint
from bacpypes3.comm import Server, ServiceAccessPoint, bind
from bacpypes3.ipv4.bvll import BVLLCodec
from bacpypes3.ipv4.service import BIPForeign, BIPNormal, UDPMultiplexer
from bacpypes3.local.device import DeviceObject
from bacpypes3.netservice import NetworkServiceAccessPoint, NetworkServiceElement
from bacpypes3.pdu import PDU, IPv4Address, LocalBroadcast

from adapters.bacnet.config import BacnetConfig

REQUESTS = (WhoIsRequest, ReadPropertyRequest, ReadPropertyMultipleRequest, SubscribeCOVRequest)
"""The only requests that are ever sent: to find devices, to read, and to be told of changes."""

HEARD = (IAmRequest, UnconfirmedCOVNotificationRequest)
"""The only requests of others that are taken notice of."""

WAITING, WAITING_FROM_ONE = 4000, 200
"""Datagrams that wait at most, in all and from one address; what comes beyond is lost, as on the network itself. A
flood from one address keeps no other from being heard."""

_CONFIRMED = {request.service_choice for request in REQUESTS if issubclass(request, ConfirmedRequestPDU)}
_UNCONFIRMED = {request.service_choice for request in REQUESTS if issubclass(request, UnconfirmedRequestPDU)}
_BVLL_IP = 0x81
_UNRECOGNIZED_SERVICE = 9

# What the library says in its log, with tracebacks for every odd datagram, is counted here.
logging.getLogger("bacpypes3").setLevel(logging.CRITICAL + 1)

Note = Callable[[str], None]
"""Takes the kind of what was malformed."""


class NotReading(Exception):
    """A request that does more than read; it has not been sent."""


def join(application: Any, access_point: Any, link_layer: Any, datagrams: Datagrams) -> None:
    application.asap = access_point
    application.nsap = NetworkServiceAccessPoint()
    application.nse = NetworkServiceElement()
    bind(application.nse, application.nsap)
    bind(application, application.asap, application.nsap)
    codec, multiplexer = BVLLCodec(), UDPMultiplexer()
    bind(link_layer, codec, multiplexer.annexJ)
    bind(multiplexer, datagrams)
    application.nsap.bind(link_layer, address=datagrams.address)


class ReadingApplication(Application):
    """An application that asks, and answers nothing but that it does not offer what is asked of it."""

    def __init__(self, network: BacnetConfig, note: Note) -> None:
        """For the port and the patience of `network`. Needs a running event loop."""
        super().__init__()
        self.foreign: BIPForeign | None = BIPForeign() if network.bbmd is not None else None
        """What registers with a BBMD, through which broadcasts go then."""
        interface = network.interface if "/" in network.interface else f"{network.interface}/32"
        self.datagrams = Datagrams(IPv4Address(f"{interface}:{network.port}"), note)
        device = DeviceObject(objectIdentifier=("device", 4194303), objectName="thermogate", vendorIdentifier=999)
        device.apduTimeout = round(network.timeout * 1000)
        device.numberOfApduRetries = network.retries
        access_point = _AccessPoint(device, self.device_info_cache, note)
        join(self, access_point, self.foreign or BIPNormal(), self.datagrams)
        self.on_notification: Callable[[UnconfirmedCOVNotificationRequest], None] = lambda _: None

    async def end(self) -> None:
        """Close everything; safe to call twice."""
        if self.foreign is not None and self.foreign.bbmdRegistrationStatus != -2:
            self.foreign.unregister()
            # That it is over is sent by a task of its own.
            await asyncio.sleep(0)
            await asyncio.sleep(0)
        await self.datagrams.close()

    def request(self, apdu: APDU) -> Any:
        """Send `apdu`; the future of its answer. Raises NotReading."""
        if not isinstance(apdu, REQUESTS):
            raise NotReading(f"{type(apdu).__name__} is not a request that reads")
        return super().request(apdu)

    async def indication(self, apdu: APDU) -> None:
        if isinstance(apdu, HEARD):
            await super().indication(apdu)
        elif isinstance(apdu, ConfirmedRequestPDU):
            await self.response(RejectPDU(reason=_UNRECOGNIZED_SERVICE, context=apdu))

    async def do_UnconfirmedCOVNotificationRequest(self, apdu: UnconfirmedCOVNotificationRequest) -> None:
        self.on_notification(apdu)


class _AccessPoint(ApplicationServiceAccessPoint):
    """The last stop of every APDU on its way to the network, and the first on its way up."""

    def __init__(self, device: DeviceObject, cache: Any, note: Note) -> None:
        super().__init__(device, cache)
        self._note = note

    async def request(self, apdu: APDU) -> None:
        """Encode `apdu` and send it. Raises NotReading."""
        if isinstance(apdu, ConfirmedRequestPDU):
            allowed = apdu.apduService in _CONFIRMED
        elif isinstance(apdu, UnconfirmedRequestPDU):
            allowed = apdu.apduService in _UNCONFIRMED
        else:
            # Refusals, and what a transaction needs.
            allowed = not isinstance(apdu, (SimpleAckPDU, ComplexAckPDU))
        if not allowed:
            raise NotReading(f"service {apdu.apduService} is not one that reads")
        await super().request(apdu)

    async def confirmation(self, pdu: PDU) -> None:
        """Decode what came; what cannot be decoded is counted where bacpypes3 passes it over."""
        if pdu.pduData and pdu.pduData[0] >> 4 == UnconfirmedRequestPDU.pduType:
            apdu = APDU.decode(pdu)
            if apdu.apduService not in {request.service_choice for request in HEARD}:
                return
            decoded = self._decoded(apdu)
            if decoded is not None:
                await self.sap_request(decoded)
        else:
            await super().confirmation(pdu)

    async def sap_response(self, apdu: APDU) -> None:
        if isinstance(apdu, ConfirmedRequestPDU):
            # What it asks for is of no concern: it is refused.
            await ServiceAccessPoint.sap_response(self, apdu)
        elif isinstance(apdu, (ComplexAckPDU, ErrorPDU)) and not isinstance(apdu, APCISequence):
            decoded = self._decoded(apdu)
            if decoded is None:
                decoded = Error(
                    source=apdu.pduSource,
                    service_choice=apdu.apduService,
                    invoke_id=apdu.apduInvokeID,
                    errorClass="communication",
                    errorCode="invalid-tag",
                )
            await ServiceAccessPoint.sap_response(self, decoded)
        else:
            await super().sap_response(apdu)

    def _decoded(self, apdu: APDU) -> APCISequence | None:
        try:
            return APCISequence.decode(apdu)
        except Exception:
            # Whatever a decoder of the library stumbles over, the datagram is to blame.
            self._note("apdu")
            return None


class Datagrams(Server[PDU]):
    """The sockets: one of this machine's own address, one for what is broadcast. Datagrams are taken one by one."""

    def __init__(self, address: IPv4Address, note: Note) -> None:
        self.address, self._note = address, note
        self._own: tuple[str, int] = address.addrTuple
        self._transports: list[asyncio.DatagramTransport] = []
        self._waiting: deque[tuple[bytes, tuple[str, int], Any]] = deque()
        self._waiting_from: Counter[tuple[str, int]] = Counter()
        self._news = asyncio.Event()
        self._taking: asyncio.Task[None] | None = None
        self.broadcasts = address.addrBroadcastTuple != address.addrTuple
        """Whether there is anybody to broadcast to."""

    async def open(self, *, broadcasts: bool, beside: bool) -> None:
        """Open the sockets; `beside`: from any free port where another program has it. Raises OSError."""
        loop = asyncio.get_running_loop()
        host, port = self.address.addrTuple

        async def own(port: int) -> asyncio.DatagramTransport:
            transport, _ = await loop.create_datagram_endpoint(
                lambda: _Receiver(self, None), local_addr=(host, port), allow_broadcast=True
            )
            return transport

        try:
            self._transports.append(await own(port))
        except OSError as error:
            if not beside or error.errno != errno.EADDRINUSE:
                raise
            self._transports.append(await own(0))
        self._own = self._transports[0].get_extra_info("sockname")
        self.broadcasts = self.broadcasts and broadcasts
        if self.broadcasts:
            # Every BACnet program of this machine listens there.
            transport, _ = await loop.create_datagram_endpoint(
                lambda: _Receiver(self, LocalBroadcast()), local_addr=self.address.addrBroadcastTuple, reuse_port=True
            )
            self._transports.append(transport)
        self._taking = asyncio.create_task(self._take())

    def received(self, data: bytes, source: tuple[str, int], destination: Any) -> None:
        """Take in a datagram; never waits."""
        if len(self._waiting) >= WAITING or self._waiting_from[source] >= WAITING_FROM_ONE:
            self._note("overrun")
            return
        self._waiting.append((data, source, destination))
        self._waiting_from[source] += 1
        self._news.set()

    async def _take(self) -> None:
        while True:
            await self._news.wait()
            self._news.clear()
            while self._waiting:
                data, source, destination = self._waiting.popleft()
                self._waiting_from[source] -= 1
                if not self._waiting_from[source]:
                    # A flood may come from ever new addresses.
                    del self._waiting_from[source]
                await self.accept(data, source, destination)
                # Whatever comes, the rest of the process has its turn.
                await asyncio.sleep(0)

    async def accept(self, data: bytes, source: tuple[str, int], destination: Any = None) -> None:
        """Pass a datagram up the stack."""
        if source == self._own:
            return
        if len(data) < 4 or data[0] != _BVLL_IP or int.from_bytes(data[2:4]) != len(data):
            self._note("not_bacnet")
            return
        try:
            await self.response(PDU(data, source=IPv4Address(source), destination=destination or self.address))
        except Exception:
            # Whatever a decoder of the library stumbles over, the datagram is to blame.
            self._note("frame")

    async def indication(self, pdu: PDU) -> None:
        destination = pdu.pduDestination
        if isinstance(destination, LocalBroadcast):
            if not self.broadcasts:
                return
            target = self.address.addrBroadcastTuple
        else:
            ip = destination if isinstance(destination, IPv4Address) else IPv4Address(destination)
            target = ip.addrTuple
        if not self._transports[0].is_closing():
            self._transports[0].sendto(pdu.pduData, target)

    async def close(self) -> None:
        """Close the sockets; safe to call twice."""
        if self._taking is not None:
            self._taking.cancel()
            with suppress(asyncio.CancelledError):
                await self._taking
        for transport in self._transports:
            transport.close()
        # The sockets themselves are closed in the next turn of the loop.
        await asyncio.sleep(0)


class _Receiver(asyncio.DatagramProtocol):
    def __init__(self, datagrams: Datagrams, destination: Any) -> None:
        self._datagrams, self._destination = datagrams, destination

    def datagram_received(self, data: bytes, source: tuple[str, int]) -> None:
        self._datagrams.received(data, source, self._destination)
