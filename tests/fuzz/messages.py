"""A message on its way through dating, stuck watch and edge to readings, and to what a person is shown."""

import math
from collections.abc import Sequence
from typing import Any

from support.sources import bound, source_table

from adapters.messages.inbox import LONGEST_PAYLOAD, Incoming
from adapters.messages.points import MessageChannel, MessageChannels
from adapters.reading import Quality

NOW = 1_772_000_000.0
TABLE = source_table("zenoh", connect=["tcp/127.0.0.1:1"], stuck_after=10.0)
EDGES: list[dict[str, Any]] = [
    {"unit": "degC"},
    {"unit": "1", "scale": 1e308, "offset": -1e308, "valid": (-1e300, 1e300)},
    {"unit": "J", "to": "W", "rollover": 65536.0},
]


def become_readings(
    payload: bytes, forms: Sequence[dict[str, Any]], stamp: float | None = None, retained: bool = False
) -> None:
    """Twice, as after a reconnect, for channels of every one of EDGES and of `forms`."""
    fits = payload if len(payload) <= LONGEST_PAYLOAD else None
    incoming = Incoming("k", fits, len(payload), stamp, NOW, retained)
    pairs = [(form, edge) for form in forms for edge in EDGES]
    listed = [bound(TABLE, f"z/{k}", key="k", **form | edge) for k, (form, edge) in enumerate(pairs)]
    channels = MessageChannels("bms", listed, TABLE)
    for _ in range(2):
        channels.start_again()
        for reading in channels.came("k", incoming):
            assert (reading.fault is None) == (reading.quality is not Quality.BAD)
            assert reading.fault is not None or (math.isfinite(reading.value) and 0 <= reading.time <= NOW + 10)
            # A retained value whose age nobody knows is never good.
            assert not retained or reading.time != NOW or reading.quality is not Quality.GOOD
    for binding in listed:
        shown = MessageChannel(binding, TABLE).look([incoming], "nothing came")
        assert "".join((shown.raw, shown.verdict, *shown.hints)).isprintable()
