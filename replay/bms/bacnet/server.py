"""The plant on BACnet/IP: every device a server of bacpypes3 with a loopback address of its own, all on one port.

Values are those of the moment they are asked for. Analogue and binary objects offer subscriptions, counters do not.
Only `replay.bms.serving` imports this module, and only where BACnet is asked for.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import math
import socket
from typing import Any

from bacpypes3.apdu import ReadPropertyMultipleRequest, ReadPropertyRequest, WhoIsRequest
from bacpypes3.app import Application
from bacpypes3.appservice import ApplicationServiceAccessPoint
from bacpypes3.basetypes import Scale
from bacpypes3.comm import bind
from bacpypes3.errors import ExecutionError
from bacpypes3.ipv4 import IPv4DatagramServer
from bacpypes3.ipv4.bvll import BVLLCodec
from bacpypes3.ipv4.service import BIPNormal, UDPMultiplexer
from bacpypes3.local.analog import AnalogInputObject
from bacpypes3.local.binary import BinaryInputObject
from bacpypes3.local.device import DeviceObject
from bacpypes3.local.object import Object as LocalObject
from bacpypes3.netservice import NetworkServiceAccessPoint, NetworkServiceElement
from bacpypes3.object import AccumulatorObject
from bacpypes3.pdu import PDU, IPv4Address, LocalBroadcast
from bacpypes3.primitivedata import ObjectIdentifier

from replay.bms.bacnet.objects import FIRST_INSTANCE, UNITS, host, objects
from replay.bms.plant import Channel, Device
from replay.bms.simulation import Simulation
from replay.errors import ReplayError

REFRESH = 1.0
"""Subscribers are told of changes so many real seconds after them at the latest."""

_VENDOR = 999
_PREFIX = 8


class _Counter(LocalObject, AccumulatorObject):
    """A counter; it has no COV criteria, and so offers no subscription."""


class LoopbackServer(IPv4DatagramServer):
    """bacpypes3's sockets on a loopback address. The library takes every loopback address for its own."""

    _transport_tasks: list[Any]

    async def indication(self, pdu: PDU) -> None:
        """Send `pdu`."""
        if self._transport_tasks:
            await asyncio.gather(*self._transport_tasks)
            self._transport_tasks = []
        await self._local_transport_ready.wait()
        destination = pdu.pduDestination
        if isinstance(destination, LocalBroadcast):
            target = self.broadcast_address
        else:
            ip = destination if isinstance(destination, IPv4Address) else IPv4Address(destination)
            target = ip.addrTuple
        if self.local_transport is not None and not self.local_transport.is_closing():
            self.local_transport.sendto(pdu.pduData, target)

    async def ready(self) -> None:
        """Wait until it listens."""
        await asyncio.gather(*self._transport_tasks)


class LoopbackDevice(Application):
    """A BACnet device at `address` ("127.0.1.1/8:47808"). Needs a running event loop."""

    def __init__(self, address: str, device: DeviceObject) -> None:
        super().__init__()
        where = IPv4Address(address)
        self.asap = ApplicationServiceAccessPoint(device, self.device_info_cache)
        self.nsap = NetworkServiceAccessPoint()
        self.nse = NetworkServiceElement()
        bind(self.nse, self.nsap)
        bind(self, self.asap, self.nsap)
        link, codec, multiplexer = BIPNormal(), BVLLCodec(), UDPMultiplexer()
        self.server = LoopbackServer(where)
        bind(link, codec, multiplexer.annexJ)
        bind(multiplexer, self.server)
        self.nsap.bind(link, address=where)
        self.add_object(device)

    def close(self) -> None:
        """Close the sockets."""
        self.server.close()


class _SimulatedDevice(LoopbackDevice):
    """A device of the plant. It is read, and nothing else: writing is refused."""

    def __init__(self, address: str, device: Device, simulation: Simulation) -> None:
        super().__init__(
            address,
            DeviceObject(
                objectIdentifier=("device", FIRST_INSTANCE + device.unit_id),
                objectName=device.name,
                vendorIdentifier=_VENDOR,
                modelName="simulated",
            ),
        )
        self._plant, self._simulation = device, simulation
        self._channels: dict[ObjectIdentifier, tuple[Channel, Any]] = {}
        for channel, kind, instance in objects(device):
            made = _object(channel, kind, instance)
            self.add_object(made)
            self._channels[made.objectIdentifier] = channel, made

    async def indication(self, apdu: Any) -> None:
        """Answer a request as the faults that act let it."""
        faults, name = self._simulation.faults, self._plant.name
        read = self._read(apdu)
        if any(faults.active(kind, name, channel) for kind in ("silent", "drop") for channel in read):
            return
        delays = [fault.value for channel in read if (fault := faults.active("slow", name, channel))]
        if delays and not isinstance(apdu, WhoIsRequest):
            await asyncio.sleep(max(delays))
        self.refresh()
        await super().indication(apdu)

    async def do_ReadPropertyRequest(self, apdu: Any) -> None:
        """Read, unless a fault has it refused."""
        self._refuse(apdu)
        await super().do_ReadPropertyRequest(apdu)

    async def do_ReadPropertyMultipleRequest(self, apdu: Any) -> None:
        """Read, unless a fault has it refused."""
        self._refuse(apdu)
        await super().do_ReadPropertyMultipleRequest(apdu)

    async def do_WritePropertyRequest(self, apdu: Any) -> None:
        """Refuse."""
        raise ExecutionError(errorClass="property", errorCode="writeAccessDenied")

    async def do_WritePropertyMultipleRequest(self, apdu: Any) -> None:
        """Refuse."""
        raise ExecutionError(errorClass="property", errorCode="writeAccessDenied")

    def refresh(self) -> None:
        """Take over the present values, of which subscribers are told."""
        if self._simulation.faults.active("silent", self._plant.name):
            return
        for channel, made in self._channels.values():
            if self._simulation.faults.active("silent", self._plant.name, channel.name):
                continue
            value = self._simulation.value(self._plant, channel)
            missing = math.isnan(value)
            if not missing:
                present = _present(channel, value)
                if made.presentValue != present:
                    made.presentValue = present
            if bool(made.statusFlags[1]) != missing:
                # The first tells subscribers; what is read, the library makes of the second.
                made.statusFlags = [0, int(missing), 0, 0]
                made.reliability = "noSensor" if missing else "noFaultDetected"

    def _refuse(self, apdu: Any) -> None:
        faults, name = self._simulation.faults, self._plant.name
        if any(faults.active("exception", name, channel) for channel in self._read(apdu)):
            raise ExecutionError(errorClass="device", errorCode="operationalProblem")

    def _read(self, apdu: Any) -> list[str | None]:
        """The channels that `apdu` asks for, and None for the device as a whole."""
        if isinstance(apdu, ReadPropertyRequest):
            identifiers = [apdu.objectIdentifier]
        elif isinstance(apdu, ReadPropertyMultipleRequest):
            identifiers = [one.objectIdentifier for one in apdu.listOfReadAccessSpecs]
        else:
            identifiers = []
        return [None, *(self._channels[one][0].name for one in identifiers if one in self._channels)]


class BacnetServer:
    """Every device of the plant; `port` is the one in use, also when it was asked for as 0."""

    def __init__(self, simulation: Simulation, port: int) -> None:
        self.port = port
        self._devices = [
            _SimulatedDevice(f"{host(index)}/{_PREFIX}:{port}", device, simulation)
            for index, device in enumerate(simulation.plant)
        ]

    @classmethod
    async def start(cls, simulation: Simulation, port: int) -> BacnetServer:
        """Listen; ReplayError if the port cannot be had."""
        # bacpypes3 reports what the faults provoke as errors of its own.
        logging.getLogger("bacpypes3").setLevel(logging.CRITICAL + 1)
        for index in range(len(simulation.plant)):
            # The library would try for ever.
            port = _free(host(index), port)
        server = cls(simulation, port)
        for device in server._devices:
            await device.server.ready()
        return server

    async def run(self) -> None:
        """Tell subscribers of changes until cancelled."""
        while True:
            for device in self._devices:
                device.refresh()
            await asyncio.sleep(REFRESH)

    async def stop(self) -> None:
        """Close every socket."""
        for device in self._devices:
            device.close()
        await asyncio.sleep(0)


def _free(address: str, port: int) -> int:
    """`port`, or any free one for 0, if `address` can be bound to it; ReplayError otherwise."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((address, port))
        except OSError as error:
            reason = "another process has it" if error.errno == errno.EADDRINUSE else (error.strerror or str(error))
            raise ReplayError(
                f"--bacnet {port}: {address}:{port} cannot be used ({reason}); choose another port, or 0 for any free "
                "one"
            ) from None
        used: int = probe.getsockname()[1]
        return used


def _object(channel: Channel, kind: str, instance: int) -> Any:
    given: dict[str, Any] = {
        "objectIdentifier": (kind, instance),
        "objectName": channel.name,
        "eventState": "normal",
        "outOfService": False,
    }
    if kind == "binary-input":
        return BinaryInputObject(presentValue="inactive", polarity="normal", **given)
    if kind == "accumulator":
        return _Counter(
            presentValue=0,
            units=UNITS[channel.unit],
            scale=Scale(integerScale=0),
            maxPresValue=_largest(channel),
            **given,
        )
    return AnalogInputObject(
        presentValue=0.0,
        units=UNITS.get(channel.unit, "noUnits"),
        covIncrement=_INCREMENTS.get(channel.unit, 0.1),
        **given,
    )


_INCREMENTS = {"degC": 0.05, "degF": 0.1, "K": 0.05, "kW": 0.01, "W": 10.0, "W/m2": 2.0, "%": 0.5}


def _largest(channel: Channel) -> int:
    """Where the counter starts again: that of its register, as far as BACnet's usual 32 bits hold it."""
    return 2 ** min(16 * channel.register.words, 32) - 1


def _present(channel: Channel, value: float) -> Any:
    if channel.register.type == "bool":
        return "active" if value >= 0.5 else "inactive"
    if channel.register.counter:
        return round(value) % (_largest(channel) + 1)
    return value
