"""InfluxDB line protocol, as Telegraf writes it: lines of measurement, tags, fields and a time. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

UNITS_PER_SECOND = {"ns": 10**9, "us": 10**6, "ms": 10**3, "s": 1}
"""How often each precision of time stamps fits into a second."""

MOST_FIELDS = 20_000
"""Fields, and tags, of a line; all of them are held until the time at its end is read."""

_SHOWN = 40
_LONGEST_NUMBER = 400

# A backslash takes the meaning from the character after it; a line feed keeps its own.
_MEASUREMENT = re.compile(r"(?:\\[^\n]|[^\\, \n])+")
_KEY = re.compile(r"(?:\\[^\n]|[^\\,= \n])+")
_STRING = re.compile(r'"((?:\\.|[^"\\])*)"', re.DOTALL)
_WORD = re.compile(r"[^, \n]+")
_BLANK = re.compile(r" +")
_TIME = re.compile(r"-?\d{1,20}(?=[ \r]*(?:\n|\Z))")
_END = re.compile(r"[ \r]*(?:\n|\Z)")
_BETWEEN = re.compile(r"(?:[ \t\r]*(?:#[^\n]*)?\n)*[ \t\r]*(?:#[^\n]*\Z)?")
_FLOAT = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_INTEGER = re.compile(r"[-+]?\d+[iu]")
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
    """Every field of every line of `text`, in order; time stamps count in `precision`, a key of UNITS_PER_SECOND.

    Raises ValueError with one sentence that names the line.
    """
    at = 0
    while (at := _match(_BETWEEN, text, at).end()) < len(text):
        try:
            fields, at = _line(text, at, UNITS_PER_SECOND[precision])
        except _Wrong as wrong:
            number = text.count("\n", 0, wrong.at) + 1
            raise ValueError(f"line {number}: {wrong.sentence}, not {_shown(text, wrong.at)}") from None
        yield from fields


class _Wrong(Exception):
    def __init__(self, at: int, sentence: str) -> None:
        super().__init__(sentence)
        self.at, self.sentence = at, sentence


def _line(text: str, at: int, per_second: int) -> tuple[list[Point], int]:
    """The fields of the line that begins at `at`, and where the next one begins."""
    measurement = _expected(_MEASUREMENT, text, at, "a line begins with a measurement")
    at, tags = measurement.end(), {}
    while text.startswith(",", at):
        key = _expected(_KEY, text, at + 1, "a tag is key=value")
        at = _after("=", text, key.end(), "a tag is key=value")
        value = _expected(_KEY, text, at, "a tag is key=value")
        tags[_plain(key[0])] = _plain(value[0])
        at = value.end()
        if len(tags) > MOST_FIELDS:
            raise _Wrong(at, f"a line has at most {MOST_FIELDS} tags")
    at = _expected(_BLANK, text, at, "fields follow after a blank").end()
    fields: list[tuple[str, float | str]] = []
    while True:
        key = _expected(_KEY, text, at, "a field is key=value")
        found, at = _value(text, _after("=", text, key.end(), "a field is key=value"))
        fields.append((_plain(key[0]), found))
        if len(fields) > MOST_FIELDS:
            raise _Wrong(at, f"a line has at most {MOST_FIELDS} fields")
        if not text.startswith(",", at):
            break
        at += 1
    time, at = _time(text, at, per_second)
    name = _plain(measurement[0])
    return [Point(name, tags, field, value, time) for field, value in fields], at


def _value(text: str, at: int) -> tuple[float | str, int]:
    if string := _STRING.match(text, at):
        return _ESCAPED_IN_STRING.sub(r"\1", string[1]), string.end()
    word = _expected(_WORD, text, at, "a field has a value")
    token = word[0].rstrip("\r")
    if token in _BOOLEANS:
        return float(_BOOLEANS[token]), at + len(token)
    # No sensor needs as many digits, and reading them takes the square of the time.
    if len(token) <= _LONGEST_NUMBER and _FLOAT.fullmatch(token):
        return float(token), at + len(token)
    if len(token) <= _LONGEST_NUMBER and _INTEGER.fullmatch(token):
        return float(token[:-1]), at + len(token)
    raise _Wrong(at, "a value is a number, true, false or a text in quotes")


def _time(text: str, at: int, per_second: int) -> tuple[float | None, int]:
    """The time stamp, if there is one, and where the next line begins."""
    if end := _END.match(text, at):
        return None, end.end()
    at = _expected(_BLANK, text, at, "a comma or a blank follows a field").end()
    stamp = _expected(_TIME, text, at, "a line ends with its time, a whole number")
    return int(stamp[0]) / per_second, _match(_END, text, stamp.end()).end()


def _match(pattern: re.Pattern[str], text: str, at: int) -> re.Match[str]:
    """The match of a pattern that also matches nothing."""
    found = pattern.match(text, at)
    assert found is not None
    return found


def _expected(pattern: re.Pattern[str], text: str, at: int, sentence: str) -> re.Match[str]:
    found = pattern.match(text, at)
    if found is None:
        raise _Wrong(at, sentence)
    return found


def _after(mark: str, text: str, at: int, sentence: str) -> int:
    if not text.startswith(mark, at):
        raise _Wrong(at, sentence)
    return at + len(mark)


def _plain(token: str) -> str:
    return _ESCAPED.sub(r"\1", token)


def _shown(text: str, at: int) -> str:
    rest = text[at : at + _SHOWN].split("\n", 1)[0]
    return "the end of the line" if not rest.strip() else ascii(rest)
