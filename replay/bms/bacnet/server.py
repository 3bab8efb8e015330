"""The plant on BACnet/IP: every device a server of bacpypes3 with a loopback address of its own, all on one port.
Analogue and binary objects offer subscriptions, counters do not. Only `replay.bms.serving` imports this module, where
BACnet is asked for."""

from __future__ import annotations

import asyncio
import errno
import math
import socket
from typing import Any

from bacpypes3.apdu import ReadPropertyMultipleRequest, ReadPropertyRequest, WhoIsRequest
from bacpypes3.app import Application
from bacpypes3.appservice import ApplicationServiceAccessPoint
from bacpypes3.basetypes import Scale
from bacpypes3.errors import ExecutionError
from bacpypes3.ipv4.service import BIPNormal
from bacpypes3.local.analog import AnalogInputObject
from bacpypes3.local.binary import BinaryInputObject
from bacpypes3.local.device import DeviceObject
from bacpypes3.local.object import Object as LocalObject
from bacpypes3.object import AccumulatorObject
from bacpypes3.pdu import IPv4Address
from bacpypes3.primitivedata import ObjectIdentifier

from adapters.bacnet.stack import Datagrams, join
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


class LoopbackDevice(Application):
    """A BACnet device at `address` ("127.0.1.1/8:47808"). Needs a running event loop."""

    def __init__(self, address: str, device: DeviceObject) -> None:
        super().__init__()
        self.datagrams = Datagrams(IPv4Address(address), lambda kind: None)
        access_point = ApplicationServiceAccessPoint(device, self.device_info_cache)
        join(self, access_point, BIPNormal(), self.datagrams)
        self.add_object(device)

    async def open(self) -> None:
        """Listen. Raises OSError."""
        await self.datagrams.open(broadcasts=True, beside=False)


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
        faults, name, read = self._simulation.faults, self._plant.name, self._read(apdu)
        if faults.on_request("silent", name, read) or faults.on_request("drop", name, read):
            return
        if not isinstance(apdu, WhoIsRequest):
            await asyncio.sleep(max((slow.value for slow in faults.on_request("slow", name, read)), default=0.0))
        self.refresh()
        await super().indication(apdu)

    async def do_ReadPropertyRequest(self, apdu: Any) -> None:
        self._refuse(apdu)
        await super().do_ReadPropertyRequest(apdu)

    async def do_ReadPropertyMultipleRequest(self, apdu: Any) -> None:
        self._refuse(apdu)
        await super().do_ReadPropertyMultipleRequest(apdu)

    async def do_WritePropertyRequest(self, apdu: Any) -> None:
        raise ExecutionError(errorClass="property", errorCode="writeAccessDenied")

    do_WritePropertyMultipleRequest = do_WritePropertyRequest

    def refresh(self) -> None:
        """Take over the present values, of which subscribers are told."""
        for channel, made in self._channels.values():
            if self._simulation.faults.on_request("silent", self._plant.name, [channel.name]):
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
        if self._simulation.faults.on_request("exception", self._plant.name, self._read(apdu)):
            raise ExecutionError(errorClass="device", errorCode="operationalProblem")

    def _read(self, apdu: Any) -> list[str]:
        """The channels that `apdu` asks for."""
        if isinstance(apdu, ReadPropertyRequest):
            identifiers = [apdu.objectIdentifier]
        elif isinstance(apdu, ReadPropertyMultipleRequest):
            identifiers = [one.objectIdentifier for one in apdu.listOfReadAccessSpecs]
        else:
            identifiers = []
        return [self._channels[one][0].name for one in identifiers if one in self._channels]


class BacnetServer:
    """Every device of the plant; `port` is the one in use, also when it was asked for as 0."""

    def __init__(self, port: int) -> None:
        self.port = port
        self._devices: list[_SimulatedDevice] = []

    @classmethod
    async def start(cls, simulation: Simulation, port: int) -> BacnetServer:
        """Listen; ReplayError if the port cannot be had."""
        if port == 0:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind((host(0), 0))
                port = probe.getsockname()[1]
        server = cls(port)
        for index, plant in enumerate(simulation.plant):
            device = _SimulatedDevice(f"{host(index)}/{_PREFIX}:{port}", plant, simulation)
            server._devices.append(device)
            try:
                await device.open()
            except OSError as error:
                await server.stop()
                reason = "another process has it" if error.errno == errno.EADDRINUSE else (error.strerror or str(error))
                raise ReplayError(
                    f"--bacnet {port}: {host(index)}:{port} cannot be used ({reason}); choose another port, or 0 for "
                    "any free one"
                ) from None
        return server

    async def run(self) -> None:
        while True:
            for device in self._devices:
                device.refresh()
            await asyncio.sleep(REFRESH)

    async def stop(self) -> None:
        for device in self._devices:
            await device.datagrams.close()


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
        whole = Scale(integerScale=0)
        most = _largest(channel)
        return _Counter(presentValue=0, units=UNITS[channel.unit], scale=whole, maxPresValue=most, **given)
    increment, units = _INCREMENTS.get(channel.unit, 0.1), UNITS.get(channel.unit, "noUnits")
    return AnalogInputObject(presentValue=0.0, units=units, covIncrement=increment, **given)


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
