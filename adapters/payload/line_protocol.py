"""InfluxDB line protocol, as Telegraf writes it: lines of measurement, tags, fields and a time. Pure."""

import re
from collections.abc import Iterator
from typing import NamedTuple

UNITS_PER_SECOND = {"ns": 10**9, "us": 10**6, "ms": 10**3, "s": 1}
"""How often each precision of time stamps fits into a second."""

MOST_FIELDS = 20_000
"""Fields, and tags, of a line; all of them are held until the time at its end is read."""

_SHOWN = 40

# A backslash takes the meaning from the character after it; a line feed keeps its own. Nothing is tried twice.
_NAME = r"(?:\\[^\n]|[^\\, \n])++"
_KEY = r"(?:\\[^\n]|[^\\,= \n])++"
_TAG = re.compile(rf",({_KEY})=({_KEY})")
_HEAD = re.compile(rf"({_NAME})((?:,{_KEY}={_KEY})*+) ++")
_FIELD = re.compile(rf'({_KEY})=("(?:\\.|[^"\\])*+"|[^, \r\n]++)', re.DOTALL)
_END = re.compile(r"(?: ++(-?[0-9]{1,20}))?[ \r]*+(?:\n|\Z)")
_BETWEEN = re.compile(r"(?:[ \t\r]*(?:#[^\n]*)?\n)*[ \t\r]*(?:#[^\n]*\Z)?")
# No sensor needs as many digits, and reading them takes the square of the time.
_FLOAT = re.compile(r"(?!.{401})[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
_INTEGER = re.compile(r"(?!.{401})([-+]?\d+)[iu]", re.ASCII)
_BOOLEANS = {word: word[0] in "tT" for word in ("t", "T", "true", "True", "TRUE", "f", "F", "false", "False", "FALSE")}
_ESCAPED = re.compile(r"\\([,= ])")
_ESCAPED_IN_STRING = re.compile(r'\\(["\\])')


class Point(NamedTuple):
    """One field of one line. `value` is a number, or text where the field is a string; `time` is UTC s or None."""

    measurement: str
    tags: dict[str, str]
    field: str
    value: float | str
    time: float | None


def points(text: str, precision: str = "ns") -> Iterator[Point]:
    """Every field of every line of `text`; times count in `precision` of UNITS_PER_SECOND. Raises ValueError."""
    at = _begin(text, 0)
    while at < len(text):
        head = _HEAD.match(text, at)
        if head is None:
            raise _wrong(text, at, "a line is a measurement, tags such as ,room=1, a blank and fields")
        tags = {_plain(tag[1]): _plain(tag[2]) for tag in _TAG.finditer(head[2])}
        fields: list[tuple[str, float | str]] = []
        at = head.end()
        while True:
            field = _FIELD.match(text, at)
            value = None if field is None else _value(field[2])
            if field is None or value is None:
                raise _wrong(text, at, "a field is key=value with a number, true, false or a text in quotes")
            fields.append((_plain(field[1]), value))
            at = field.end()
            if max(len(tags), len(fields)) > MOST_FIELDS:
                raise _wrong(text, at, f"a line has at most {MOST_FIELDS} tags and fields")
            if not text.startswith(",", at):
                break
            at += 1
        end = _END.match(text, at)
        if end is None:
            raise _wrong(text, at, "a comma and a field follow, or a blank and the time, a whole number")
        time = None if end[1] is None else int(end[1]) / UNITS_PER_SECOND[precision]
        for name, value in fields:
            yield Point(_plain(head[1]), tags, name, value, time)
        at = _begin(text, end.end())


def _begin(text: str, at: int) -> int:
    """Where the next line begins, after blank ones and comments."""
    found = _BETWEEN.match(text, at)
    assert found is not None, "it also matches nothing"
    return found.end()


def _value(token: str) -> float | str | None:
    """A number or a text; None for anything else."""
    if token.startswith('"'):
        return _ESCAPED_IN_STRING.sub(r"\1", token[1:-1]) if len(token) > 1 and token.endswith('"') else None
    if token in _BOOLEANS:
        return float(_BOOLEANS[token])
    integer = _INTEGER.fullmatch(token)
    number = integer[1] if integer else token if _FLOAT.fullmatch(token) else None
    return None if number is None else float(number)


def _wrong(text: str, at: int, sentence: str) -> ValueError:
    rest = text[at : at + _SHOWN].split("\n", 1)[0]
    found = "the end of the line" if not rest.strip() else ascii(rest)
    return ValueError(f"line {text.count(chr(10), 0, at) + 1}: {sentence}, not {found}")


def _plain(token: str) -> str:
    return _ESCAPED.sub(r"\1", token)
