"""Live telemetry of BACnet/IP devices, read only."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING

from adapters.bacnet.config import BacnetConfig
from adapters.bacnet.objects import COV_INCREMENT, OBJECT_NAME, PRESENT_VALUE, STATUS_FLAGS, UNITS
from adapters.bacnet.points import BacnetChannel, Seen, addresses, probed
from adapters.bacnet.values import known, number, text, whole
from adapters.channel import Binding
from adapters.errors import SourceUnavailable
from adapters.reading import Batch, Probe
from adapters.watched import Channels, LiveSource, Seldom

if TYPE_CHECKING:
    from adapters.bacnet.client import BacnetLink, Device, Notification
    from adapters.bacnet.session import Session
    from adapters.scanning import Scan, Scanned

_ROOM = 1000
_LOOK = 0.5
_DEVICES_SHOWN = 8
_OCTETS = 256
_COARSE = 0.2
"""A subscription that shows no smaller change than this, in K, hides what a model of a room lives on."""

_log = logging.getLogger(__name__)


class BacnetSource(LiveSource):
    """Devices of a BACnet/IP network, each followed by itself; a batch is what one brings in a poll, dated when it
    arrives. Silent ones are asked after pauses up to 30 s; if all are, `batches` raises SourceUnavailable."""

    def __init__(self, name: str, table: BacnetConfig, bindings: Sequence[Binding]) -> None:
        super().__init__(name, bindings)
        self.malformed: Counter[str] = Counter()
        """What came and could not be used, by kind: no BACnet/IP at all, a frame or an APDU that cannot be decoded, a
        notification without values, and what found no room (overrun)."""
        self._table = table
        self._channels = Channels(name, bindings, lambda one: BacnetChannel(one, table.poll))
        self._late = 0
        self._sessions: dict[int, Session] = {}
        self._seldom = Seldom()

    @property
    def late(self) -> int:
        return self._late + sum(session.rhythm.late for session in self._sessions.values())

    def check(self) -> list[str]:
        problems = []
        if find_spec("bacpypes3") is None:
            problems.append(
                f"sources.{self.name}: BACnet needs bacpypes3; install it with: pip install 'thermogate[bacnet]'"
            )
        lost = [str(device) for device, address in addresses(self._channels.all()).items() if address is None]
        if lost and not self._table.broadcasts:
            problems.append(
                f"sources.{self.name}: nobody can be asked where device {lost[0]} is: give interface its prefix, such "
                f'as interface = "{self._table.interface.split("/")[0]}/24", or give bbmd, or say at '
                "which address each device is"
            )
        return problems

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        arrived: asyncio.Queue[Batch] = asyncio.Queue(_ROOM)
        tasks: dict[int, asyncio.Task[None]] = {}
        async with self._opened(self._made) as link:
            try:
                link.listen(self._heard)
                self._rebound = True
                while True:
                    if self._rebound:
                        self._rebound = False
                        self._channels.replace(self._listed)
                        self._follow(link, arrived, tasks)
                    with suppress(TimeoutError):
                        async with asyncio.timeout(_LOOK):
                            batch = await arrived.get()
                        yield batch
                    for task in tasks.values():
                        if task.done():
                            task.result()
                    sessions = self._sessions.values()
                    if arrived.empty() and sessions and all(session.silent for session in sessions):
                        raise SourceUnavailable(self._nobody())
            finally:
                for task in tasks.values():
                    task.cancel()
                await asyncio.gather(*tasks.values(), return_exceptions=True)
                self._late, self._sessions = self.late, {}

    async def probe(self, seconds: float) -> list[Probe]:
        from adapters.bacnet.client import NoAnswer, Refused

        async with self._opened(partial(self._made, beside=True)) as link:
            devices: dict[int, Device | str] = {}
            others: tuple[str, ...] = ()
            for instance, address in addresses(self._channels.all()).items():
                try:
                    devices[instance] = await link.find(instance, address)
                except (NoAnswer, Refused) as error:
                    devices[instance] = f"{error}; check device, address and the network"
            if self._table.broadcasts and any(isinstance(device, str) for device in devices.values()):
                found = await link.who_is(seconds)
                listed = ", ".join(f"{one.instance} ({one.address})" for one in found[:_DEVICES_SHOWN])
                others = (f"devices that answer: {listed or 'none'}",)
            probes = []
            for channel in (BacnetChannel(binding, self._table.poll) for binding in self._listed):
                device = devices[channel.device]
                hints: tuple[str, ...] = ()
                try:
                    if not isinstance(device, str):
                        probes.append(await _look(link, device, channel))
                        continue
                    verdict, hints = device, others
                except NoAnswer as error:
                    verdict = str(error)
                except Refused as error:
                    verdict = f"the device refuses it: {error}; check object, or list what there is with --scan"
                probes.append(Probe(channel.id, channel.place, "-", None, None, verdict, hints))
            return probes

    async def scan(self, wanted: Scan) -> Scanned:
        from adapters.bacnet.scan import scan

        async with self._opened(partial(self._made, beside=True)) as link:
            return await scan(link, wanted, broadcasts=self._table.broadcasts)

    def _made(self, *, beside: bool = False) -> BacnetLink:
        from adapters.bacnet.client import BacnetLink

        return BacnetLink(self._table, self._note, beside=beside)

    def _follow(self, link: BacnetLink, arrived: asyncio.Queue[Batch], tasks: dict[int, asyncio.Task[None]]) -> None:
        from adapters.bacnet.session import Session

        devices = addresses(self._channels.all())
        for device in tasks.keys() - devices.keys():
            tasks.pop(device).cancel()
            self._late += self._sessions.pop(device).rhythm.late
        for index, device in enumerate(devices):
            if device in tasks:
                self._sessions[device].rebound()
                continue
            session = Session(self.name, device, link, self._channels, self._table, arrived.put)
            self._sessions[device] = session
            phase = self._table.poll * (index + 1) / len(devices)
            tasks[device] = asyncio.create_task(session.follow(phase), name=f"source {self.name} device {device}")

    def _heard(self, notification: Notification) -> None:
        for session in self._sessions.values():
            if session.heard(notification):
                return

    def _nobody(self) -> str:
        reasons = [session.reason for session in self._sessions.values()]
        more = "" if len(reasons) == 1 else f", and {len(reasons) - 1} other{'s' * (len(reasons) > 2)}"
        return f"{reasons[0]}{more}; check device, address and the network"

    def _note(self, kind: str) -> None:
        self.malformed[kind] += 1
        if self._seldom(kind):
            say = "sources.%s: something came that cannot be used (%s); %d of this kind so far"
            _log.warning(say, self.name, kind, self.malformed[kind])


async def _look(link: BacnetLink, device: Device, channel: BacnetChannel) -> Probe:
    """One channel's object. Raises NoAnswer or Refused."""
    from adapters.bacnet.client import Refused

    asked = (PRESENT_VALUE, STATUS_FLAGS, UNITS, OBJECT_NAME, COV_INCREMENT)
    values, when = (await link.ask(device, [channel.object], asked, _OCTETS))[channel.object]
    value, flags, units, *others = (values[kind] for kind in asked)
    if isinstance(value, Refused):
        raise value
    name, increment = known(text, others[0]), known(number, others[1])
    hints = [] if name is None else [f'the device calls it "{name}"']
    temperature = channel.unit in ("degC", "K", "degF")
    if increment and channel.cov and temperature and channel.edge.change(increment) > _COARSE:
        hints.append(f"its COV increment is {increment:g}: a subscription shows no smaller change; cov = false polls")
    seen = Seen(value, None if isinstance(flags, Refused) else flags, known(whole, units))
    return probed(channel, seen, when, hints)
