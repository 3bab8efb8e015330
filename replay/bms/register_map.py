"""The register map of the simulated plant, for people."""

from collections.abc import Sequence

from replay.bms.plant import Channel, Device
from service.cli.tables import aligned

HEADINGS = ("device", "unit_id", "channel", "table", "register", "words", "type", "order", "scale", "unit", "missing")
"""`register` counts from 0, `missing` is what "not available" is."""


def as_text(plant: Sequence[Device]) -> list[str]:
    """The map as lines of a table."""
    return aligned([HEADINGS, *(_row(device, channel) for device in plant for channel in device.channels)])


def _row(device: Device, channel: Channel) -> tuple[str, ...]:
    register = channel.register
    missing = "NaN" if register.type.startswith("float") else ""
    if register.sentinel is not None:
        missing = f"0x{register.sentinel % 2 ** (16 * register.words):0{4 * register.words}X}"
    order = "" if register.type == "bool" else register.order
    place = (register.table, str(register.address), str(register.words), register.type, order, f"{register.scale:g}")
    return (device.name, str(device.unit_id), channel.name, *place, channel.unit, missing)
