"""What a BMS puts on Zenoh: three ways to write the same readings."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from typing import NamedTuple

from adapters.fields.times import written_to_the_millisecond

_SENML_UNITS = {"degC": "Cel", "1": "/", "Wh": "Wh"}  # RFC 8428 and 8798; W, K, % and W/m2 are written as they are


class Published(NamedTuple):
    """A value of a channel in `unit` at UTC seconds `time`; NaN is "not available"."""

    channel: str
    unit: str
    time: float
    value: float


def plain(reading: Published) -> bytes:
    """The number alone; its time is Zenoh's own."""
    return f"{reading.value:.6g}".encode()


def as_json(reading: Published) -> bytes:
    """An object with value, unit, RFC 3339 time and quality."""
    missing = math.isnan(reading.value)
    document = {
        "present": {"value": None if missing else round(reading.value, 6), "unit": reading.unit},
        "time": written_to_the_millisecond(reading.time),
        "quality": "bad" if missing else "good",
    }
    return json.dumps(document).encode()


def senml(device: str, readings: Iterable[Published]) -> bytes:
    """All readings of a device as one SenML-like pack (RFC 8428): base name, epoch seconds, one record per channel.

    A value that is not available is null, which SenML itself would leave out.
    """
    records: list[dict[str, object]] = [
        {
            "n": reading.channel,
            "u": _SENML_UNITS.get(reading.unit, reading.unit),
            "v": None if math.isnan(reading.value) else round(reading.value, 6),
            "t": round(reading.time, 3),
        }
        for reading in readings
    ]
    if records:
        records[0] = {"bn": f"{device}/", **records[0]}
    return json.dumps(records).encode()
