"""Line protocol: the documented examples, what is escaped, and the same as a parser of somebody else's."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from line_protocol_parser import parse_line

from adapters.payload.line_protocol import Point, points


def read(text: str, precision: str = "ns") -> list[Point]:
    return list(points(text, precision))


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (
            "weather,location=us-midwest temperature=82 1465839830100400200",
            Point("weather", {"location": "us-midwest"}, "temperature", 82.0, 1465839830.1004002),
        ),
        ("weather temperature=82.5", Point("weather", {}, "temperature", 82.5, None)),
        ("weather temperature=-.5e-1", Point("weather", {}, "temperature", -0.05, None)),
        ("modbus,slave_id=1 power=1200i", Point("modbus", {"slave_id": "1"}, "power", 1200.0, None)),
        ("modbus power=18446744073709551615u", Point("modbus", {}, "power", 2.0**64, None)),
        ("relay on=T", Point("relay", {}, "on", 1.0, None)),
        ("relay on=false 5", Point("relay", {}, "on", 0.0, 5e-9)),
        (
            r"wea\,ther,loca\=tion=us\ mid\,west tem\ p=1",
            Point("wea,ther", {"loca=tion": "us mid,west"}, "tem p", 1, None),
        ),
        (r'note text="so \"hot\", he said: \\ = 1"', Point("note", {}, "text", r'so "hot", he said: \ = 1', None)),
        ('note text="two\nlines" 7', Point("note", {}, "text", "two\nlines", 7e-9)),
        (r"w,path=C:\dir v=1", Point("w", {"path": r"C:\dir"}, "v", 1.0, None)),
        ("a b=1\r", Point("a", {}, "b", 1.0, None)),
    ],
)
def test_a_line(line: str, expected: Point) -> None:
    assert read(line) == [expected]


def test_lines_comments_and_several_fields() -> None:
    text = "# from telegraf\n\ncpu idle=1,user=2i 3\n  \nmem used=4 5\n# the end"
    assert [(one.measurement, one.field, one.value, one.time) for one in read(text, "s")] == [
        ("cpu", "idle", 1.0, 3.0),
        ("cpu", "user", 2.0, 3.0),
        ("mem", "used", 4.0, 5.0),
    ]


@pytest.mark.parametrize(("precision", "stamp"), [("ns", "1500000000"), ("us", "1500000"), ("ms", "1500"), ("s", "1")])
def test_precision(precision: str, stamp: str) -> None:
    (point,) = read(f"a b=1 {stamp}", precision)
    assert point.time == (1.0 if precision == "s" else 1.5)


FIELD = "a field is key=value with a number, true, false or a text in quotes"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a", "line 1: a line is a measurement, tags such as ,room=1, a blank and fields, not 'a'"),
        ("ok b=1\n\nbad", "line 3: a line is a measurement, tags such as ,room=1, a blank and fields, not 'bad'"),
        ("a,t= b=1", "line 1: a line is a measurement, tags such as ,room=1, a blank and fields, not 'a,t= b=1'"),
        (",t=1 b=1", "line 1: a line is a measurement, tags such as ,room=1, a blank and fields, not ',t=1 b=1'"),
        *((f"a {wrong}", f"line 1: {FIELD}, not {wrong!r}") for wrong in ("b", "b=nan", "b=1_0", 'b="open')),
        ("a b=1,", f"line 1: {FIELD}, not the end of the line"),
        ("a b=1 soon", "line 1: a comma and a field follow, or a blank and the time, a whole number, not ' soon'"),
        ("a b=1 1.5", "line 1: a comma and a field follow, or a blank and the time, a whole number, not ' 1.5'"),
        ("a b=\uff11", f"line 1: {FIELD}, not 'b=\\uff11'"),
        ("a b=\uff11i", f"line 1: {FIELD}, not 'b=\\uff11i'"),
        ("a b=1 \uff11", "line 1: a comma and a field follow, or a blank and the time, a whole number, not ' \\uff11'"),
        (f"a b={'9' * 500}", f"line 1: {FIELD}, not 'b={'9' * 38}'"),
    ],
)
def test_what_is_no_line_is_refused_with_its_place(text: str, sentence: str) -> None:
    with pytest.raises(ValueError, match="line") as refused:
        read(text)
    assert str(refused.value) == sentence


WORD = st.text("abcXYZ019_.-/:", min_size=1, max_size=8)
NUMBER = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False).map(repr),
    st.integers(-(2**63), 2**63 - 1).map(lambda number: f"{number}i"),
    st.sampled_from(["t", "T", "true", "True", "TRUE", "f", "F", "false", "False", "FALSE"]),
)
ESCAPES = str.maketrans({",": r"\,", "=": r"\=", " ": r"\ "})
NAME = st.text("abc ,=é", min_size=1, max_size=6)


@settings(max_examples=150, deadline=None, derandomize=True, database=None)
@given(
    measurement=WORD,
    tags=st.dictionaries(NAME, NAME, max_size=3),
    fields=st.dictionaries(NAME, NUMBER, min_size=1, max_size=4),
    stamp=st.one_of(st.none(), st.integers(0, 2**62)),
)
def test_it_reads_what_another_parser_reads(
    measurement: str, tags: dict[str, str], fields: dict[str, str], stamp: int | None
) -> None:
    written = "".join(f",{key.translate(ESCAPES)}={value.translate(ESCAPES)}" for key, value in tags.items())
    values = ",".join(f"{key.translate(ESCAPES)}={value}" for key, value in fields.items())
    line = f"{measurement}{written} {values}{'' if stamp is None else f' {stamp}'}"
    theirs = parse_line(line)
    ours = read(line)
    assert {one.measurement for one in ours} == {theirs["measurement"]}
    assert all(one.tags == theirs["tags"] for one in ours)
    assert {one.field: one.value for one in ours} == {key: float(value) for key, value in theirs["fields"].items()}
    assert {one.time for one in ours} == {None if stamp is None else theirs["time"] / 10**9}
