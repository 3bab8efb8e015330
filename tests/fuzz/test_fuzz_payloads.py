"""Payloads, posted bodies, SenML packs, JSON pointers, times: whatever comes is a value or a fault, in a sentence."""

import json
import math
from contextlib import suppress
from typing import Any
from zoneinfo import ZoneInfo

from fuzz.fuzzing import raw, structured
from fuzz.messages import EDGES, NOW, TABLE, become_readings
from hypothesis import strategies as st
from support.sources import bound, source_table

from adapters.messages.config import MessageChannelConfig
from adapters.messages.decoding import Decoded, Rejected, decode
from adapters.payload import json_pointer
from adapters.payload.line_protocol import UNITS_PER_SECOND, points
from adapters.payload.times import TIME_FORMATS, parse_time
from adapters.reading import Quality
from service.web.readings import read, unpacked
from service.web.server.refusal import RequestRefused

BERLIN = ZoneInfo("Europe/Berlin")
DOCUMENT = b'{"present": {"value": 19.96, "unit": "degC"}, "time": "2026-01-15T12:00:00.000Z", "quality": "good"}'
PACK = b'[{"bn": "room2/", "bt": 1772000000, "bu": "Cel", "n": "T", "v": 21.5}, {"n": "u", "u": "W", "v": 4, "t": -5}]'
JSON = {
    "format": "json",
    "value": "/present/value",
    "time": "/time",
    "quality": "/quality",
    "time_zone": "Europe/Berlin",
}
EPOCH = {
    "format": "json",
    "value": "/v/0",
    "time": "/t",
    "quality": "/q",
    "time_format": "epoch_ms",
    "good": ["192", "true"],
}
PACKS = [{"format": "senml", "quality": "/q", "record": "room2/T", "unit": "degC"}, {"format": "senml"}]
PLAIN: dict[str, Any] = {}


def taken(payload: bytes, *forms: dict[str, Any], stamp: float | None = None) -> None:
    """What the payload says in each of `forms` has the form that it should have, and becomes readings."""
    for form in forms:
        said(payload, bound(TABLE, "z/T", key="k", **form).channel)
    become_readings(payload, [{key: form[key] for key in form if key != "unit"} for form in forms], stamp)


def said(payload: bytes, form: MessageChannelConfig) -> list[Decoded | Rejected]:
    """What the payload says, after a look at its form."""
    entries = decode(payload, form, NOW)
    for entry in entries:
        if isinstance(entry, Rejected):
            assert entry.sentence.isprintable(), "a log line is one line"
            assert len(entry.sentence) < 1000
            entry.sentence.encode()
        else:
            assert isinstance(entry.raw, float)
            assert entry.time is None or math.isfinite(entry.time)
            assert entry.quality is not Quality.BAD
    return entries


@raw(b"21.5", b" -1e-3\n", b"true", b"null", b"nan", b"\xef\xbb\xbf7", examples=300)
def test_plain_payload(data: bytes) -> None:
    taken(data, PLAIN)


@raw(DOCUMENT, b'{"v": [1, 2], "t": 1772000000000, "q": 192}', b"[1, [2, {}]]")
def test_json_payload(data: bytes) -> None:
    taken(data, JSON, EPOCH, stamp=NOW - 3)


@raw(PACK, b'{"n": "T", "vb": true}', b'[{"bv": 1, "bver": 10, "s": 2, "vs": "x"}, {"v_": 1}]')
def test_senml_payload(data: bytes) -> None:
    taken(data, *PACKS)


@raw(b"/present/value", b"/a~1b/0", b"/~0", b"", b"/007/-", examples=200)
def test_json_pointer(data: bytes) -> None:
    text = data.decode("utf-8", "replace")
    try:
        tokens = json_pointer.parse(text)
    except ValueError:
        return
    assert "".join(f"/{token.replace('~', '~0').replace('/', '~1')}" for token in tokens) == text
    for document in ({"a": [0, {"b": 1}], "": 2, "0": 3}, [[1], 2], 5, None):
        json_pointer.resolve(document, tokens)


@raw(b"2026-01-15T12:00:00Z", b"2026-03-29T02:30", b"1772000000", b"20260115", b"0001-01-01T00:00+23:59")
def test_payload_time(data: bytes) -> None:
    text = data.decode("utf-8", "replace")
    for form in TIME_FORMATS:
        for zone in (None, BERLIN, ZoneInfo("Pacific/Apia")):
            with suppress(ValueError):
                assert math.isfinite(parse_time(text, form, zone, NOW))


LINES = (
    b"weather,location=us-midwest temperature=82 1465839830100400200",
    b'room2,topic=a\\ b T=21.5,u=4i,on=t,note="two\nlines, \\"q\\"" 1772000000000000000\n# end\nroom2 T=-1e-3\r\n',
)


@raw(*LINES)
def test_line_protocol(data: bytes) -> None:
    text = data.decode("utf-8", "replace")
    for precision in UNITS_PER_SECOND:
        try:
            found = list(points(text, precision))
        except ValueError as error:
            assert str(error).isprintable()
            assert str(error).startswith("line ")
            assert len(str(error)) < 300
            continue
        for point in found:
            assert point.measurement
            assert point.field
            assert isinstance(point.value, float | str)
            assert point.time is None or math.isfinite(point.time)


POSTED = source_table("http").build(
    "post",
    [
        bound(source_table("http"), f"room2/{name}", name="roof", **edge)
        for name, edge in zip(("T", "u", "on"), EDGES, strict=True)
    ],
)
BODIES = {
    "application/json": b'{"readings": [{"channel": "T", "value": 21.5, "time": "2026-02-25T06:13:20Z"}]}',
    "application/senml+json": PACK,
    "text/plain": LINES[1],
}


@raw(*BODIES.values(), b'{"readings": [{"channel": "roof", "value": null, "quality": "bad", "unit": "K"}]}')
def test_posted_body(data: bytes) -> None:
    for media_type in BODIES:
        for encoding in ("identity", "gzip"):
            headers = {"content-type": media_type, "content-encoding": encoding}
            try:
                body = unpacked(data, headers, 10_000) if "content-encoding" in headers else data
                posted = read(body, headers, "ns")
            except RequestRefused as refused:
                assert refused.status in (400, 413, 415, 422)
                json.dumps(refused.members)
                continue
            for one in posted:
                assert one.shown.isprintable()
                one.shown.encode()
            for zone in ("room2", None):
                for reading in POSTED.receive(posted, zone, NOW).readings:
                    assert (reading.fault is None) == (reading.quality is not Quality.BAD)
                    assert math.isfinite(reading.time)
                    assert reading.fault is not None or math.isfinite(reading.value)


LEAVES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(-(10**400), 10**400),
    st.floats(),
    st.text(),
    st.text(alphabet="\ud800\udfff\x00\n\u2028é", max_size=5),
    st.sampled_from(["good", "nan", "1e400", "2026-01-15T12:00:00Z", "9999-12-31T23:59:59.999999-23:59", "_"]),
)
TREES = st.recursive(
    LEAVES,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=4), inner, max_size=4)),
    max_leaves=8,
)
LABELS = st.sampled_from(["bn", "bt", "bu", "bv", "bver", "n", "u", "v", "vb", "vs", "vd", "s", "t", "ut", "q", "x_"])


@structured(
    examples=80,
    document=st.fixed_dictionaries(
        {},
        optional={
            "present": st.one_of(TREES, st.fixed_dictionaries({"value": TREES})),
            "time": TREES,
            "quality": TREES,
            "v": st.lists(TREES, max_size=2),
            "t": TREES,
            "q": TREES,
        },
    ),
)
def test_json_document(document: object) -> None:
    taken(json.dumps(document).encode(), JSON, EPOCH)


@structured(examples=80, pack=st.lists(st.dictionaries(LABELS, TREES, max_size=6), max_size=5))
def test_senml_pack(pack: object) -> None:
    taken(json.dumps(pack).encode(), *PACKS)
