"""Which registers Modbus units have, and what numbers might be in them. Reads only, and bounded."""

import math
from collections.abc import Iterator, Mapping, Sequence

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
    stretch = range(begin - first_register, end - first_register + 1)
    for one in range(first_unit, last_unit + 1):
        try:
            for table in wanted.tables:
                longest = source.max_registers * (16 if table in BIT_TABLES else 1)
                words, said = await _look(link, one, table, stretch, longest)
                rows += _rows(one, table, words, first_register)
                remarks += said
        except NoAnswer as error:
            remarks.append(f"unit {one}: {error}")
    return Scanned(rows, remarks)


async def _look(
    link: ModbusLink, unit: int, table: str, stretch: range, longest: int
) -> tuple[dict[int, int], list[str]]:
    """Registers or bits of a table by address, in as few requests as the device allows, and remarks."""
    words: dict[int, int] = {}
    reasons: list[str] = []
    parts = [stretch[begin : begin + longest] for begin in range(0, len(stretch), longest)]
    while parts and len(reasons) < MOST_REFUSALS:
        part = parts.pop(0)
        try:
            answer = await link.read(unit, table, part[0], len(part))
        except Refused as error:
            reasons.append(str(error))
            middle = len(part) // 2
            parts[:0] = [part[:middle], part[middle:]] if middle else []
        else:
            words |= dict(enumerate(answer.words, part[0]))
    if len(reasons) >= MOST_REFUSALS:
        return words, [f"unit {unit} {table}: given up after {MOST_REFUSALS} refused requests; narrow --registers"]
    return words, [] if words else [f"unit {unit} {table}: nothing there ({reasons[-1]})"]


def _rows(unit: int, table: str, words: Mapping[int, int], first_register: int) -> Iterator[tuple[str, ...]]:
    for address, word in sorted(words.items()):
        if word == 0 and words.get(address - 1, 0) == 0 and words.get(address + 1, 0) == 0:
            # Long stretches of nothing would hide what there is.
            continue
        place = str(unit), table, str(address + first_register)
        if table in BIT_TABLES:
            yield (*place, "-", str(word), "-")
            continue
        guesses = ", ".join(_guesses([words[k] for k in (address, address + 1) if k in words]))
        yield (*place, f"0x{word:04x}", f"{decode([word], Format('int16')):.0f}", guesses or "-")


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
