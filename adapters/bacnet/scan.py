"""Who is on a BACnet network, and what numbers each device has to offer. Reads only."""

from collections.abc import Callable

from adapters.bacnet.client import BacnetLink, Device, NoAnswer, Refused
from adapters.bacnet.objects import (
    DEVICE,
    LARGEST_INSTANCE,
    OBJECT_LIST,
    OBJECT_NAME,
    PRESENT_VALUE,
    STATUS_FLAGS,
    TYPES,
    UNITS,
    ObjectId,
)
from adapters.bacnet.units import unit_of
from adapters.bacnet.values import Flags, Unreadable, Value, flags, known, number, object_id, text, whole
from adapters.errors import SourceConfigError
from adapters.scanning import Scan, Scanned

MOST_DEVICES = 250
MOST_OBJECTS = 2000
"""Bounds of one scan: devices, and objects of each."""

HEADINGS = ("device", "address", "object", "name", "value", "unit", "status")

_OCTETS = 128


async def scan(link: BacnetLink, wanted: Scan, *, broadcasts: bool) -> Scanned:
    """The devices that answer a Who-Is within the time of `wanted`, and their objects whose values are numbers."""
    if not broadcasts:
        raise SourceConfigError(
            "a scan asks everybody: give interface its prefix, such as 192.168.1.10/24, or bbmd; or name the devices "
            "in channels, with at, and probe without --scan"
        )
    lowest, highest = wanted.devices or (0, LARGEST_INSTANCE)
    found = {device.instance: device for device in await link.who_is(wanted.seconds, lowest, highest)}
    rows: list[tuple[str, ...]] = [HEADINGS]
    remarks = [] if found else [f"no device from {lowest} to {highest} answers within {wanted.seconds:g} s"]
    for instance in sorted(found)[:MOST_DEVICES]:
        try:
            device = await link.find(instance, found[instance].address)
            rows += await _rows(link, device, remarks)
        except (NoAnswer, Refused) as error:
            remarks.append(f"device {instance}: {error}")
    if len(found) > MOST_DEVICES:
        remarks.append(f"{len(found)} devices answer, {MOST_DEVICES} were looked at; narrow it with --devices")
    return Scanned(rows, remarks)


async def _rows(link: BacnetLink, device: Device, remarks: list[str]) -> list[tuple[str, ...]]:
    objects = [object for object in await _objects(link, device, remarks) if object.type in TYPES.values()]
    if not objects:
        remarks.append(f"device {device.instance} ({device.address}) has no object whose value is a number")
    answers = await link.ask(device, objects, (OBJECT_NAME, PRESENT_VALUE, UNITS, STATUS_FLAGS), _OCTETS)
    return [
        (
            str(device.instance),
            str(device.address),
            str(object),
            _shown(text, answer.values[OBJECT_NAME]),
            _shown(_value, answer.values[PRESENT_VALUE]),
            _shown(_unit, answer.values[UNITS]),
            _shown(_status, answer.values[STATUS_FLAGS]),
        )
        for object, answer in answers.items()
    ]


async def _objects(link: BacnetLink, device: Device, remarks: list[str]) -> list[ObjectId]:
    """The object list of a device, at once or, where that is too long, one by one."""
    what = ObjectId(DEVICE, device.instance), OBJECT_LIST
    try:
        listed = await link.read_list(device, *what)
    except Refused:
        length = known(whole, await link.read_one(device, *what, 0))
        if length is None:
            raise Refused("it does not say how many objects it has") from None
        count = min(length, MOST_OBJECTS + 1)
        listed = [await link.read_one(device, *what, index) for index in range(1, count + 1)]
    if len(listed) > MOST_OBJECTS:
        remarks.append(f"device {device.instance} has more than {MOST_OBJECTS} objects; the first were looked at")
    try:
        return [ObjectId(*object_id(value)) for value in listed[:MOST_OBJECTS]]
    except Unreadable as error:
        raise Refused(f"its list of objects {error}") from error


def _shown(read: Callable[[Value], object], value: Value | Refused) -> str:
    if isinstance(value, Refused):
        return "-"
    try:
        return str(read(value))
    except Unreadable as error:
        return str(error)


def _value(value: Value) -> str:
    found = number(value)
    if found is None:
        return "-"
    return f"{found:.0f}" if found.is_integer() else f"{found:.6g}"


def _unit(value: Value) -> str:
    return unit_of(whole(value)) or f"(unit {whole(value)})"


def _status(value: Value) -> str:
    return str(flags(value)) if flags(value) != Flags() else "ok"
