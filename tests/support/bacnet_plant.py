"""BACnet devices on loopback for tests: bacpypes3's own server, faults on demand, and a record of what was asked."""

import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from bacpypes3.apdu import ConfirmedRequestPDU, RejectPDU, SubscribeCOVRequest
from bacpypes3.basetypes import ServicesSupported, StatusFlags
from bacpypes3.comm import bind
from bacpypes3.errors import ExecutionError
from bacpypes3.ipv4.bvll import BVLLCodec
from bacpypes3.ipv4.service import BIPBBMD, UDPMultiplexer
from bacpypes3.local.analog import AnalogInputObject, AnalogValueObject
from bacpypes3.local.binary import BinaryInputObject
from bacpypes3.local.device import DeviceObject
from bacpypes3.pdu import IPv4Address

from adapters.bacnet.stack import Datagrams
from replay.bms.bacnet.server import LoopbackDevice

READS = {"WhoIsRequest", "ReadPropertyRequest", "ReadPropertyMultipleRequest", "SubscribeCOVRequest"}
"""The requests that change nothing in a device."""

STATUS = {"eventState": "normal", "outOfService": False}


def free_udp_port() -> int:
    """A port that no loopback address of this machine has at the moment."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("0.0.0.0", 0))
        return probe.getsockname()[1]


class _Overridden(AnalogInputObject):
    """An input that somebody has overridden, which the library does not know."""

    @property
    def statusFlags(self) -> StatusFlags:
        return StatusFlags([0, 0, 1, 0])


class Peer(LoopbackDevice):
    """A device on 127.0.7.`host`. `asked` are the names of the requests that came; changes take effect at once."""

    def __init__(self, instance: int, port: int, host: int = 1, longest: int = 1024) -> None:
        super().__init__(
            f"127.0.7.{host}/8:{port}",
            DeviceObject(
                objectIdentifier=("device", instance),
                objectName=f"device {instance}",
                vendorIdentifier=999,
                maxApduLengthAccepted=longest,
            ),
        )
        self.where = f"127.0.7.{host}:{port}"
        self.asked: list[str] = []
        self.silent = False
        self.without: set[str] = set()
        """Names of requests that it does not know."""
        self.refused: set[tuple[str, int]] = set()
        """Objects to which it refuses subscriptions."""

    def add(self, name: str = "analog-input,1", value: Any = 21.5, units: str = "degreesCelsius", **more: Any) -> Any:
        """Add an object."""
        kind, _, number = name.partition(",")
        overridden = more.pop("overridden", False)
        given = {"objectIdentifier": (kind, int(number)), "objectName": f"name of {name}", **STATUS, **more}
        if kind == "binary-input":
            made = BinaryInputObject(presentValue=value, polarity="normal", **given)
        else:
            maker = _Overridden if overridden else AnalogInputObject
            maker = maker if kind == "analog-input" else AnalogValueObject
            made = maker(presentValue=value, units=units, covIncrement=given.pop("covIncrement", 0.1), **given)
        self.add_object(made)
        return made

    def get_services_supported(self) -> ServicesSupported:
        """What it says that it knows."""
        services = super().get_services_supported()
        for name, bit in (("ReadPropertyMultipleRequest", 14), ("SubscribeCOVRequest", 5)):
            if name in self.without:
                services[bit] = 0
        return services

    async def indication(self, apdu: Any) -> None:
        """Answer, or not."""
        name = type(apdu).__name__
        self.asked.append(name)
        if self.silent:
            return
        if name in self.without and isinstance(apdu, ConfirmedRequestPDU):
            await self.response(RejectPDU(reason=9, context=apdu))
            return
        await super().indication(apdu)

    async def do_SubscribeCOVRequest(self, apdu: SubscribeCOVRequest) -> None:
        """Subscribe, unless that is refused."""
        kind, number = apdu.monitoredObjectIdentifier
        if (str(kind), int(number)) in self.refused:
            raise ExecutionError(errorClass="resources", errorCode="noSpaceToAddListElement")
        await super().do_SubscribeCOVRequest(apdu)


def one_device(value: float | None = 21.5, **settings: Any) -> tuple[int, Peer]:
    """A port, and device 1201 there with "analog-input,1" at `value`, None for without."""
    port = free_udp_port()
    peer = Peer(1201, port, **settings)
    if value is not None:
        peer.add(value=value)
    return port, peer


@asynccontextmanager
async def serving(*peers: Peer) -> AsyncIterator[None]:
    """Serve until the block ends; whatever came was a request that reads."""
    for peer in peers:
        await peer.open()
    try:
        yield
    finally:
        for peer in peers:
            # Subscriptions that are left end by timers of their own.
            for detection in list(peer._cov_detections.values()):
                for subscription in list(detection.cov_subscriptions):
                    peer.cancel_subscription(subscription)
            await peer.datagrams.close()
    for peer in peers:
        assert set(peer.asked) <= READS | {"IAmRequest"}, "a source of telemetry only reads, ever"


class Bbmd:
    """A broadcast management device on 127.0.7.200, which passes broadcasts of foreign devices on to the network."""

    def __init__(self, port: int) -> None:
        where = IPv4Address(f"127.0.7.200/8:{port}")
        self.where = f"127.0.7.200:{port}"
        self.table, codec, multiplexer = BIPBBMD(where), BVLLCodec(), UDPMultiplexer()
        self.datagrams = Datagrams(where, lambda kind: None)
        bind(self.table, codec, multiplexer.annexJ)
        bind(multiplexer, self.datagrams)
        self.table.add_peer(where)

    async def close(self) -> None:
        """Close the sockets, and stop the clock of the table."""
        self.table._fdt_clock_handle.cancel()
        await self.datagrams.close()
