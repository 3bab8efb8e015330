"""Where the channels of the plant are on BACnet: devices, objects, addresses and units, for people and for programs."""

from collections import Counter
from collections.abc import Sequence

from replay.bms.plant import Channel, Device

FIRST_INSTANCE = 1000
"""The instance of a device is so much more than its Modbus unit id."""

CLIENT = "127.0.0.1"
"""The loopback address that no device has."""

UNITS = {
    "degC": "degreesCelsius",
    "degF": "degreesFahrenheit",
    "K": "degreesKelvin",
    "W": "watts",
    "kW": "kilowatts",
    "W/m2": "wattsPerSquareMeter",
    "%": "percent",
    "Wh": "wattHours",
}
"""BACnet's names of the plant's units."""

_HOSTS = 250


def host(index: int) -> str:
    return f"127.0.{1 + index // _HOSTS}.{1 + index % _HOSTS}"


def objects(device: Device) -> list[tuple[Channel, str, int]]:
    """Every channel of `device` with the type and the instance of its object; instances count from 1."""
    counted: Counter[str] = Counter()
    found = []
    for channel in device.channels:
        kind = _kind(channel)
        counted[kind] += 1
        found.append((channel, kind, counted[kind]))
    return found


def served(plant: Sequence[Device], port: int | None) -> str:
    """Where the devices answer, for the greeting; `port` None: nowhere."""
    if port is None:
        return "off"
    first, last = FIRST_INSTANCE + plant[0].unit_id, FIRST_INSTANCE + plant[-1].unit_id
    where = f"{host(0)} to {host(len(plant) - 1)} port {port}"
    return f"{where}; devices {first} to {last}; read from {CLIENT}/8"


def _kind(channel: Channel) -> str:
    if channel.register.type == "bool":
        return "binary-input"
    return "accumulator" if channel.register.counter else "analog-input"
