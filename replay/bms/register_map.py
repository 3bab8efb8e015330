"""The register map of the simulated plant, for people and for programs."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

from replay.bms.plant import Channel, Device

HEADINGS = ("device", "unit_id", "channel", "table", "register", "words", "type", "order", "scale", "unit", "missing")


def rows(plant: Iterable[Device]) -> list[tuple[str, ...]]:
    """One row of cells under HEADINGS per channel; `register` counts from 0, `missing` is what "not available" is."""
    return [_row(device, channel) for device in plant for channel in device.channels]


def as_csv(plant: Iterable[Device]) -> str:
    """The map as CSV."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(HEADINGS)
    writer.writerows(rows(plant))
    return stream.getvalue()


def as_text(plant: Sequence[Device]) -> list[str]:
    """The map as lines of a table; of devices that are there for load, the first one's first row."""
    table = [HEADINGS, *rows(device for device in plant if device.published)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in table]
    load = [device for device in plant if not device.published]
    if load:
        first, last = load[0], load[-1]
        lines.append(
            f"{first.name} (unit id {first.unit_id}) to {last.name} ({last.unit_id}): input registers 0 to "
            f"{len(first.channels) - 1}, int16, scale 0.1, degC"
        )
    return lines


def _row(device: Device, channel: Channel) -> tuple[str, ...]:
    register = channel.register
    missing = "NaN" if register.type.startswith("float") else ""
    if register.sentinel is not None:
        missing = f"0x{register.sentinel % 2 ** (16 * register.words):0{4 * register.words}X}"
    return (
        device.name,
        str(device.unit_id),
        channel.name,
        register.table,
        str(register.address),
        str(register.words),
        register.type,
        "" if register.type == "bool" else register.order,
        f"{register.scale:g}",
        channel.unit,
        missing,
    )
