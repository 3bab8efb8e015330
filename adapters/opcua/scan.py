"""What numbers an OPC UA server has to offer. Reads only."""

from __future__ import annotations

from adapters.opcua.client import OpcuaLink
from adapters.reading import Fault
from adapters.scanning import Scanned

MOST = 2000
"""Variables that one scan looks at."""

HEADINGS = ("node", "name", "value", "unit", "status")


async def scan(link: OpcuaLink) -> Scanned:
    """The variables below the folder of objects whose values are numbers. Raises SourceUnavailable."""
    names = await link.variables(MOST)
    seen = await link.read(list(names))
    numeric = [node for node in names if seen[node].judged().fault is not Fault.NON_NUMERIC]
    units = await link.units(numeric)
    rows: list[tuple[str, ...]] = [HEADINGS]
    for node in numeric:
        raw = seen[node].judged().raw
        rows.append((node, names[node], "-" if raw is None else f"{raw:.6g}", units.get(node, "-"), seen[node].status))
    remarks = [f"the first {MOST} variables were looked at"] if len(names) >= MOST else []
    return Scanned(rows, remarks if len(rows) > 1 else [*remarks, "the server has no variable whose value is a number"])
