"""Register blocks: every pattern of every type is a number or a fault, through edge and probe."""

import math
import struct
from typing import Any

from fuzz.fuzzing import raw, structured
from hypothesis import strategies as st
from support.sources import bound, source_table

from adapters.modbus.client import Answer
from adapters.modbus.codec import ORDERS, TABLES, TYPES, Format, decode, is_available, other_orders
from adapters.modbus.plan import Point, halves, plan
from adapters.modbus.points import ModbusChannel, readings
from adapters.modbus.probing import probed
from adapters.reading import Quality
from adapters.watched import Channels

TABLE = source_table("modbus", host="127.0.0.1", first_register=0)
EDGES = [
    {"unit": "degC"},
    {"unit": "degF", "to": "degC", "scale": 0.1, "offset": -40.0, "valid": (-1e300, 1e300)},
    {"unit": "MW", "to": "W", "scale": 1e308, "valid": (-1e300, 1e300)},
    {"unit": "kWh", "to": "W", "rollover": 65536.0, "valid": (-1e300, 1e300)},
]
SEEDS = [struct.pack(">d", value) for value in (21.5, math.nan, math.inf, -0.0, 5e-324)]


def read(words: list[int], form: Format, edge: dict[str, Any]) -> None:
    """One answer, and a second one a moment later, as the source takes them."""
    written = {"type": form.type, "order": form.order, "bit": form.bit, "not_available": form.not_available}
    binding = bound(TABLE, "z/T", register=0, stuck_after=1.0, **written, **edge)
    channel = ModbusChannel(binding, TABLE)
    channels = Channels("bms", [binding], lambda one: ModbusChannel(one, TABLE))
    for time in (1_772_000_000.0, 1_772_000_001.5):
        for request in plan(channels.points, TABLE):
            for reading in readings(channels, request, Answer(words, time)):
                assert (reading.fault is None) == (reading.quality is not Quality.BAD)
                assert reading.fault is not None or math.isfinite(reading.value)
    shown = probed(channel, Answer(words, 1_772_000_000.0), Answer(words[::-1], 1_772_000_005.0))
    assert "".join((shown.raw, shown.verdict, *shown.hints)).isprintable()


@raw(*SEEDS, b"\x7f\xc0\x00\x00\x80\x00\xff\xff\x01", examples=300)
def test_register_block(data: bytes) -> None:
    """Bytes as registers, of each type and order that they suffice for."""
    block = data.ljust(9, b"\xff")
    words = list(struct.unpack(">4H", block[:8]))
    choice = block[8]
    for kind in TYPES:
        bit = choice % 16 if kind == "bool" and choice % 3 else None
        form = Format(kind, ORDERS[choice % 4], bit, (math.nan, 0x8000, -32768.0) if choice % 2 else ())
        used = words[: form.registers]
        assert isinstance(decode(used, form), float)
        is_available(used, form)
        assert all(math.isfinite(number) for number in other_orders(used, form).values())
        read(used, form, EDGES[choice % len(EDGES)])


@structured(
    examples=150,
    points=st.lists(
        st.builds(
            Point, st.integers(0, 255), st.sampled_from(TABLES), st.integers(0, 65535), st.sampled_from([1, 2, 4])
        ),
        unique=True,
        max_size=40,
    ),
    batch=st.booleans(),
    registers=st.integers(4, 125),
    gap=st.integers(0, 100),
)
def test_plan_of_requests(points: list[Point], batch: bool, registers: int, gap: int) -> None:
    """Every point is asked for, once, whole, and within what a request may hold."""
    requests = plan(points, TABLE.model_copy(update={"batch": batch, "max_registers": registers, "fill_gaps": gap}))
    assert sorted([point for request in requests for point in request.points]) == sorted(points)
    for request in requests:
        assert request.size <= registers * (16 if request.table in ("coil", "discrete") else 1)
        for point in request.points:
            assert (point.unit, point.table) == (request.unit, request.table)
            assert request.address <= point.address
            assert point.address + point.size <= request.address + request.size
        if len(request.points) > 1:
            parts = halves(request)
            assert sorted(point for part in parts for point in part.points) == sorted(request.points)
