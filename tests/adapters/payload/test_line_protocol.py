"""Line protocol: the documented examples, what is escaped, and the same as a parser of somebody else's."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from line_protocol_parser import parse_line
from support.tables import tabled

from adapters.payload.line_protocol import Point, points


def read(text, precision="ns"):
    return list(points(text, precision))


@tabled
def test_a_line(line, expected):
    assert read(line) == [Point(*expected)]


def test_lines_comments_and_several_fields():
    text = "# from telegraf\n\ncpu idle=1,user=2i 3\n  \nmem used=4 5\n# the end"
    assert [(one.measurement, one.field, one.value, one.time) for one in read(text, "s")] == [
        ("cpu", "idle", 1.0, 3.0),
        ("cpu", "user", 2.0, 3.0),
        ("mem", "used", 4.0, 5.0),
    ]


@pytest.mark.parametrize(("precision", "stamp"), [("ns", "1500000000"), ("us", "1500000"), ("ms", "1500"), ("s", "1")])
def test_precision(precision, stamp):
    (point,) = read(f"a b=1 {stamp}", precision)
    assert point.time == (1.0 if precision == "s" else 1.5)


@tabled
def test_what_is_no_line_is_refused_with_its_place(text, sentence):
    with pytest.raises(ValueError, match="line") as refused:
        read(text)
    assert str(refused.value) == sentence


def test_a_line_without_end_is_shown_in_part():
    with pytest.raises(ValueError, match=f"not 'b={'9' * 38}'$"):
        read(f"a b={'9' * 500}")


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
def test_it_reads_what_another_parser_reads(measurement, tags, fields, stamp):
    written = "".join(f",{key.translate(ESCAPES)}={value.translate(ESCAPES)}" for key, value in tags.items())
    values = ",".join(f"{key.translate(ESCAPES)}={value}" for key, value in fields.items())
    line = f"{measurement}{written} {values}{'' if stamp is None else f' {stamp}'}"
    theirs = parse_line(line)
    ours = read(line)
    assert {one.measurement for one in ours} == {theirs["measurement"]}
    assert all(one.tags == theirs["tags"] for one in ours)
    assert {one.field: one.value for one in ours} == {key: float(value) for key, value in theirs["fields"].items()}
    assert {one.time for one in ours} == {None if stamp is None else theirs["time"] / 10**9}
