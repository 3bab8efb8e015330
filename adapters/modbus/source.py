"""Live telemetry polled from Modbus devices, read only."""

import logging
import time
from collections import deque
from collections.abc import AsyncIterator, Sequence
from functools import partial
from importlib.util import find_spec
from typing import NamedTuple

from adapters.channel import Binding
from adapters.errors import SourceUnavailable
from adapters.modbus.client import ModbusLink, NoAnswer, Refused
from adapters.modbus.config import ModbusConfig
from adapters.modbus.plan import Point, Request, halves, plan
from adapters.modbus.points import ModbusChannel, readings
from adapters.modbus.probing import probe_all
from adapters.modbus.scan import scan
from adapters.reading import Batch, Fault, Probe
from adapters.rhythm import Rhythm
from adapters.scanning import Scan, Scanned
from adapters.watched import Channels, LiveSource

LONGEST_SILENCE = 30.0
"""After this time at the latest a silent unit is asked again, in s."""

REFUSAL = 600.0
"""After this time registers that a device does not have are asked for again, in s. Those that it cannot give now are
asked for after a pause that grows from FAILURE to this."""

FAILURE = 1.0

_BETWEEN_COUNTS = 5.0
"""Between the two readings of a counter that is probed, at most, in s."""

_log = logging.getLogger(__name__)


class _LeftAlone(NamedTuple):
    """A silent unit, or registers not given: for how long they are left alone, and until when (monotonic s)."""

    pause: float
    until: float
    lasting: bool = False


class ModbusSource(LiveSource):
    """Modbus units behind one connection, polled at one pace; a batch is what one answer brings, dated when it arrives.
    A refused request is split until the registers are found that are refused; they are asked for again later. A silent
    unit is left alone for up to LONGEST_SILENCE; if all are silent, `batches` raises SourceUnavailable."""

    def __init__(self, name: str, table: ModbusConfig, bindings: Sequence[Binding]) -> None:
        super().__init__(name, bindings)
        self._table = table
        self._channels = Channels(name, bindings, lambda one: ModbusChannel(one, table))
        self._rhythm = Rhythm(f"sources.{name}", table.poll)
        self._requests: list[Request] = []
        self._whole_until = -1.0
        """Monotonic s until which the requests stay as they are; then those that were split are tried whole again."""
        self._refusals: dict[Point, _LeftAlone] = {}
        self._silent: dict[int, _LeftAlone] = {}

    @property
    def late(self) -> int:
        return self._rhythm.late

    def check(self) -> list[str]:
        if self._table.serial is not None and find_spec("serial") is None:
            return [
                f"sources.{self.name}: a serial port needs pyserial; install it with: pip install 'thermogate[serial]'"
            ]
        return []

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        async with self._opened(partial(ModbusLink, self._table)) as link:
            self._rhythm.begin()
            while True:
                async for batch in self._round(link):
                    yield batch
                await self._rhythm.wait()

    async def probe(self, seconds: float) -> list[Probe]:
        """Every channel, each by a request of its own; counters twice, `seconds` apart at most."""
        async with self._opened(partial(ModbusLink, self._table)) as link:
            channels = [ModbusChannel(binding, self._table) for binding in self._listed]
            return await probe_all(link, channels, min(seconds, _BETWEEN_COUNTS))

    async def scan(self, wanted: Scan) -> Scanned:
        async with self._opened(partial(ModbusLink, self._table)) as link:
            return await scan(link, wanted, self._table)

    async def _round(self, link: ModbusLink) -> AsyncIterator[Batch]:
        """Everything once, but for units that are left alone."""
        now = time.monotonic()
        if self._rebound:
            # Between two rounds: the requests of a round that is under way are for the channels there were.
            self._channels.replace(self._listed)
            self._rebound, self._whole_until = False, now
            points = set(self._channels.points)
            self._refusals = {point: refusal for point, refusal in self._refusals.items() if point in points}
            units = {point.unit for point in points}
            self._silent = {unit: silence for unit, silence in self._silent.items() if unit in units}
        if now >= self._whole_until:
            wanted = (
                one for one in self._channels.points if one not in self._refusals or self._refusals[one].until <= now
            )
            self._requests = plan(wanted, self._table)
            untils = (refusal.until for refusal in self._refusals.values() if refusal.until > now)
            self._whole_until = min(untils, default=float("inf"))
        left_alone = {unit for unit, silence in self._silent.items() if silence.until > now}
        to_send = deque(self._requests)
        while to_send:
            request = to_send.popleft()
            if request.unit in left_alone:
                continue
            try:
                answer = await link.read(request.unit, request.table, request.address, request.size)
            except Refused as error:
                self._requests.remove(request)
                if len(request.points) > 1:
                    self._whole_until = min(self._whole_until, now + REFUSAL)
                    parts = halves(request)
                    self._requests += parts
                    to_send.extendleft(reversed(parts))
                else:
                    (point,) = request.points
                    self._note_refusal(point, error)
                    yield Batch(self._channels.bad(point, Fault.REFUSED_BY_DEVICE), time.time())
            except NoAnswer as error:
                left_alone.add(request.unit)
                self._note_silence(request.unit, str(error))
            else:
                self._note_answer(request)
                yield Batch(list(readings(self._channels, request, answer)), answer.time)
        units = {point.unit for point in self._channels.points}
        if units <= self._silent.keys():
            self._silent.clear()
            raise SourceUnavailable(f"{self._table.place} is connected but silent; check unit_id and the device")

    def _note_refusal(self, point: Point, error: Refused) -> None:
        before, pause = self._refusals.get(point), REFUSAL
        if not error.lasting:
            pause = min(2 * before.pause if before and not before.lasting else max(FAILURE, self._table.poll), REFUSAL)
        verb, again = "refuses", f"every {REFUSAL / 60:.0f} min"
        if not error.lasting:
            verb, again = "cannot give", f"in {pause:.0f} s, then after growing pauses"
        self._channels.note_refusal(point, str(error), again, verb)
        until = time.monotonic() + pause
        self._refusals[point] = _LeftAlone(pause, until, error.lasting)
        self._whole_until = min(self._whole_until, until)

    def _note_silence(self, unit: int, reason: str) -> None:
        before = self._silent.get(unit)
        if before is None:
            _log.warning("sources.%s: unit %d is silent: %s; going on with the others", self.name, unit, reason)
        pause = min(2 * before.pause if before else self._table.poll, LONGEST_SILENCE)
        self._silent[unit] = _LeftAlone(pause, time.monotonic() + pause)

    def _note_answer(self, request: Request) -> None:
        if self._silent.pop(request.unit, None) is not None:
            _log.info("sources.%s: unit %d answers again", self.name, request.unit)
        for point in self._refusals.keys() & set(request.points):
            del self._refusals[point]
            self._channels.note_value(point)
