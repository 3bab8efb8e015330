"""Live telemetry of an OPC UA server, read only."""

from __future__ import annotations

import logging
import time
from collections.abc import AsyncIterator, Sequence
from typing import TYPE_CHECKING

from adapters.channel import Binding
from adapters.opcua.config import OpcuaConfig
from adapters.opcua.values import Seen
from adapters.reading import Batch, Fault, Probe, Reading
from adapters.rhythm import Rhythm
from adapters.scanning import Scan, Scanned
from adapters.watched import POLLS_IN_A_STRETCH, Channels, LiveSource, Watched

if TYPE_CHECKING:
    from adapters.opcua.client import OpcuaLink

CONFIRM = 60.0
"""Nodes with a subscription are read as well after this time, in s."""

MOST = 2000
"""Variables that one scan looks at."""

_STATE = "i=2259"
"""The node of the server's own state."""

HEADINGS = ("node", "name", "value", "unit", "status")

_log = logging.getLogger(__name__)


class OpcuaChannel(Watched):
    """A channel at work, by the node whose value it is."""

    def __init__(self, binding: Binding, poll: float) -> None:
        super().__init__(binding, POLLS_IN_A_STRETCH * poll)
        self.point = str(binding.channel.node)
        self.subscribe = bool(binding.channel.subscribe)


class OpcuaSource(LiveSource):
    """The nodes of one server, subscribed to or read at every poll, which brings a batch. A value has the time stamp of
    its source if that is from after the last poll, else the poll's: most servers leave that of a value that stays the
    same. `batches` raises SourceUnavailable where the connection is lost."""

    def __init__(self, name: str, table: OpcuaConfig, bindings: Sequence[Binding]) -> None:
        super().__init__(name, bindings)
        self._table = table
        self._channels = Channels(name, bindings, lambda one: OpcuaChannel(one, table.poll))
        self._rhythm = Rhythm(f"sources.{name}", table.poll)
        self._subscribed: dict[str, Seen] = {}
        """What was last seen of the nodes with a subscription."""

    @property
    def late(self) -> int:
        return self._rhythm.late

    def check(self) -> list[str]:
        return [f"sources.{self.name}: {problem}" for problem in self._table.problems()]

    async def batches(self, start: float | None) -> AsyncIterator[Batch]:
        async with self._opened(self._made) as link:
            self._rhythm.begin()
            polled, confirm = time.time() - self._table.poll, 0.0
            self._rebound = True
            while True:
                if self._rebound:
                    await self._follow(link)
                    confirm = 0.0
                everything = time.monotonic() >= confirm
                seen = await self._look(link, everything)
                confirm = time.monotonic() + CONFIRM if everything else confirm
                now = time.time()
                yield Batch([one for node in seen for one in self._readings(node, seen[node], polled, now)], now)
                polled = now
                await self._rhythm.wait()

    async def probe(self, seconds: float) -> list[Probe]:
        channels = [OpcuaChannel(binding, self._table.poll) for binding in self._listed]
        nodes = list(dict.fromkeys(channel.point for channel in channels))
        async with self._opened(self._made) as link:
            seen, units = await link.read(nodes), await link.units(nodes)
        return [_probed(channel, seen[channel.point], units.get(channel.point)) for channel in channels]

    async def scan(self, wanted: Scan) -> Scanned:
        async with self._opened(self._made) as link:
            names = await link.variables(MOST)
            seen = await link.read(list(names))
            numeric = [node for node in names if seen[node].judged().fault is not Fault.NON_NUMERIC]
            units = await link.units(numeric)
        rows: list[tuple[str, ...]] = [HEADINGS]
        for node in numeric:
            raw, status = seen[node].judged().raw, seen[node].status
            rows.append((node, names[node], "-" if raw is None else f"{raw:.6g}", units.get(node, "-"), status))
        remarks = [f"the first {MOST} variables were looked at"] if len(names) >= MOST else []
        none = [] if numeric else ["the server has no variable whose value is a number"]
        return Scanned(rows, remarks + none)

    def _made(self) -> OpcuaLink:
        from adapters.opcua.client import OpcuaLink

        return OpcuaLink(self._table)

    async def _follow(self, link: OpcuaLink) -> None:
        """Take up the channels that are listed now, and subscribe to those that allow it."""
        self._rebound = False
        self._channels.replace(self._listed)
        allowed = [node for node in self._channels.points if all(one.subscribe for one in self._channels.at(node))]
        wanted = allowed if self._table.poll < CONFIRM else []
        refused = await link.subscribe(wanted, self._table.poll)
        for node, status in list(refused.items())[:1]:
            say = "sources.%s: the server offers no subscription to %d of %d nodes, such as %s (%s); they are polled"
            _log.info(say, self.name, len(refused), len(wanted), node, status)
        self._subscribed = {node: Seen(None) for node in wanted if node not in refused}

    async def _look(self, link: OpcuaLink, everything: bool) -> dict[str, Seen]:
        """What every node has now; `everything` reads those with a subscription too: notifications get lost."""
        told = link.taken()
        self._subscribed |= {node: told[node] for node in self._subscribed.keys() & told.keys()}
        to_read = [node for node in self._channels.points if everything or node not in self._subscribed]
        # Where nothing is to be read, the server has to answer all the same.
        found = await link.read(to_read or [_STATE])
        self._subscribed |= {node: found[node] for node in self._subscribed.keys() & found.keys()}
        return {node: found[node] for node in to_read} | self._subscribed

    def _readings(self, node: str, seen: Seen, polled: float, now: float) -> list[Reading]:
        """The readings that `seen` brings, between the last poll and now, UTC s."""
        if seen.is_refusal:
            self._channels.note_refusal(node, seen.status, "at every poll")
        else:
            self._channels.note_value(node)
        when = seen.time if seen.time is not None and polled < seen.time <= now else now
        verdict = seen.judged()
        return self._channels.readings(node, lambda _: verdict, when)


def _probed(channel: OpcuaChannel, seen: Seen, unit: str | None) -> Probe:
    hints = () if unit is None else (f"the server states its unit as {unit}",)
    shown = f"{seen.value:.6g}" if isinstance(seen.value, float) else str(seen.value)
    return channel.probed(seen.judged(), "-" if seen.value is None else shown[:40], seen.time or time.time(), hints)
