"""Which registers Modbus units have, and what numbers might be in them. Reads only, and bounded."""

from __future__ import annotations

import math
from collections.abc import Sequence

from adapters.errors import SourceConfigError
from adapters.modbus.client import ModbusLink, NoAnswer, Refused
from adapters.modbus.codec import BIT_TABLES, Format, decode
from adapters.modbus.config import ModbusConfig
from adapters.scanning import Scan, Scanned

MOST = 20_000
"""Registers and bits that one scan may look at, all units and tables together."""

MOST_REFUSALS = 200
"""After so many refused requests a table of a unit is given up: its registers lie too far apart to be found so."""

HEADINGS = ("unit", "table", "register", "hex", "int16", "might be")

_FLOATS = ("ABCD", "CDAB")
_SMALLEST, _LARGEST = 1e-3, 1e7
_DEFAULT = 100


async def scan(link: ModbusLink, wanted: Scan, source: ModbusConfig) -> Scanned:
    """What the units of `wanted` (default: that of `source`) have in its registers. Raises SourceUnavailable, and
    SourceConfigError where that is more than MOST."""
    first_register = source.first_register
    first_unit, last_unit = wanted.devices or (source.unit_id, source.unit_id)
    begin, end = wanted.registers or (first_register, first_register + _DEFAULT - 1)
    if last_unit > 255:
        raise SourceConfigError(f"--devices {first_unit}-{last_unit}: a unit id is at most 255")
    if not first_register <= begin <= end <= 65535 + first_register:
        raise SourceConfigError(
            f"--registers {begin}-{end}: the registers of this source are {first_register} to {65535 + first_register}"
        )
    everything = (last_unit - first_unit + 1) * (end - begin + 1) * len(wanted.tables)
    if everything > MOST:
        raise SourceConfigError(
            f"that is {everything} registers; a scan looks at {MOST} at most: narrow --devices, --registers or --tables"
        )
    rows: list[tuple[str, ...]] = [HEADINGS]
    remarks: list[str] = []
    for one in range(first_unit, last_unit + 1):
        try:
            for table in wanted.tables:
                looked = _Table(link, one, table, source.max_registers * (16 if table in BIT_TABLES else 1))
                await looked.look(begin - first_register, end - begin + 1)
                rows += _rows(looked, first_register)
                remarks += looked.remarks()
        except NoAnswer as error:
            remarks.append(f"unit {one}: {error}")
    return Scanned(rows, remarks)


class _Table:
    """A table of a unit, as far as it has been looked at."""

    def __init__(self, link: ModbusLink, unit: int, table: str, longest: int) -> None:
        self.unit, self.table = unit, table
        self.words: dict[int, int] = {}
        """Registers or bits by their address."""
        self._link, self._longest = link, longest
        self._refusals = 0
        self._reason = ""

    async def look(self, address: int, count: int) -> None:
        """Read `count` registers from `address` on, in as few requests as the device gives them away in."""
        for begin in range(address, address + count, self._longest):
            await self._part(begin, min(self._longest, address + count - begin))

    async def _part(self, address: int, count: int) -> None:
        if self._refusals >= MOST_REFUSALS:
            return
        try:
            answer = await self._link.read(self.unit, self.table, address, count)
        except Refused as error:
            self._refusals += 1
            self._reason = str(error)
            if count > 1:
                await self._part(address, count // 2)
                await self._part(address + count // 2, count - count // 2)
            return
        self.words |= dict(enumerate(answer.words, address))

    def remarks(self) -> list[str]:
        """What there is to say beside the registers."""
        where = f"unit {self.unit} {self.table}"
        if self._refusals >= MOST_REFUSALS:
            return [f"{where}: given up after {MOST_REFUSALS} refused requests; narrow --registers"]
        return [] if self.words else [f"{where}: nothing there ({self._reason})"]


def _rows(table: _Table, first_register: int) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for address in sorted(table.words):
        word = table.words[address]
        if word == 0 and table.words.get(address - 1, 0) == 0 and table.words.get(address + 1, 0) == 0:
            # Long stretches of nothing would hide what there is.
            continue
        register = str(address + first_register)
        if table.table in BIT_TABLES:
            rows.append((str(table.unit), table.table, register, "-", str(word), "-"))
            continue
        guesses = ", ".join(_guesses([table.words[k] for k in range(address, address + 4) if k in table.words]))
        signed = f"{decode([word], Format('int16')):.0f}"
        rows.append((str(table.unit), table.table, register, f"0x{word:04x}", signed, guesses or "-"))
    return rows


def _guesses(words: Sequence[int]) -> list[str]:
    """What numbers of plausible size could begin in the first of `words`."""
    if len(words) < 2:
        return []
    found = []
    for order in _FLOATS:
        value = decode(words[:2], Format("float32", order))
        # Two small whole numbers beside each other make no float of such a size.
        if math.isfinite(value) and _SMALLEST <= abs(value) <= _LARGEST:
            found.append(f"float32 {order} {value:.6g}")
    return found
