"""Looking at everything that a source could deliver, for the person who has no list of it."""

from typing import NamedTuple, Protocol, runtime_checkable


class Scan(NamedTuple):
    """What is looked at: `devices` (Modbus units, BACnet instances) and `registers`, the first and the last as the
    operator numbers them (None: the source's own), and for how many `seconds` answers are waited for."""

    devices: tuple[int, int] | None = None
    registers: tuple[int, int] | None = None
    tables: tuple[str, ...] = ("holding", "input")
    seconds: float = 5.0


class Scanned(NamedTuple):
    """What was found: rows of cells under the headings in the first one, and sentences about what was not."""

    rows: list[tuple[str, ...]]
    remarks: list[str]


@runtime_checkable
class Scannable(Protocol):
    """A source that can be scanned."""

    async def scan(self, wanted: Scan) -> Scanned:
        """Look, reading only. Raises SourceUnavailable, and SourceConfigError where `wanted` is more than one scan
        may be."""
        ...
