"""What a payload says: plain numbers, JSON documents and SenML packs as values with their time and quality. Pure."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from math import isfinite
from typing import Any, NamedTuple, TypeVar
from zoneinfo import ZoneInfo

from adapters.payload import senml
from adapters.payload.json_pointer import MISSING, numbers, resolve, write
from adapters.payload.times import NaiveTime, parse_time
from adapters.reading import Fault, Quality

Found = TypeVar("Found")

FORMATS = ("plain", "json", "senml")

_SHOWN = 60
_SENTENCE = 300
_NUMBERS = 8
_NOTHING = {"", "null", "none"}
_WORDS = {"true": 1.0, "false": 0.0}


@dataclass(frozen=True)
class PayloadFormat:
    """How a payload is written.

    Pointers are tuples of reference tokens (`json_pointer.parse`); those to time and quality may be None. `good` and
    `uncertain` list what stands for these qualities, as `quality_word` writes it. `record` names the SenML record, and
    `unit` the unit that its `u` must be where it says one; None for any.
    """

    kind: str = "plain"
    value: tuple[str, ...] = ()
    time: tuple[str, ...] | None = None
    quality: tuple[str, ...] | None = None
    time_format: str = "iso8601"
    zone: ZoneInfo | None = None
    good: frozenset[str] = frozenset({"good"})
    uncertain: frozenset[str] = frozenset({"uncertain"})
    record: str | None = None
    unit: str | None = None


class Decoded(NamedTuple):
    """A value. `time` is UTC s, or if `relative` s from another time of the sample on; None where the payload has
    none."""

    raw: float
    time: float | None = None
    relative: bool = False
    quality: Quality = Quality.GOOD


class Rejected(NamedTuple):
    """Why there is no value; `sentence` goes on from "the payload"."""

    fault: Fault
    sentence: str


class _Refusal(Exception):
    def __init__(self, fault: Fault, sentence: str) -> None:
        super().__init__(sentence)
        # What a publisher writes must neither fill the log nor look like lines of it.
        self.rejected = Rejected(fault, _printable(sentence, _SENTENCE))


class Payload:
    """The bytes of a message, which are parsed once, however many channels read them."""

    def __init__(self, content: bytes) -> None:
        self.content = content

    @cached_property
    def text(self) -> str | Rejected:
        """What they are as text."""
        return _or_rejected(_text, self.content)

    @cached_property
    def document(self) -> Any:
        """What they are as JSON, or Rejected."""
        return _or_rejected(_parsed, self.content)

    @cached_property
    def records(self) -> Mapping[str, Sequence[senml.Record]] | Rejected:
        """The records of a SenML pack by their names."""
        return _or_rejected(_records, self.document)


def decode(payload: Payload | bytes, form: PayloadFormat, near: float) -> list[Decoded | Rejected]:
    """What `payload`, which came at `near` (UTC s), says: one entry, or of a SenML pack one per record meant."""
    parsed = Payload(payload) if isinstance(payload, bytes) else payload
    found = getattr(parsed, {"plain": "text", "json": "document", "senml": "records"}[form.kind])
    if isinstance(found, Rejected):
        return [found]
    try:
        if form.kind == "plain":
            return [Decoded(_number(found))]
        if form.kind == "json":
            return [_from_json(found, form, near)]
        return list(_from_senml(found, form))
    except _Refusal as refusal:
        return [refusal.rejected]


def _or_rejected(read: Callable[[Any], Found], source: object) -> Found | Rejected:
    """What `read` makes of `source`, or why it is refused, which is known once and for all, too."""
    if isinstance(source, Rejected):
        return source
    try:
        return read(source)
    except _Refusal as refusal:
        return refusal.rejected


def shown(payload: bytes) -> str:
    """`payload` for people, shortened."""
    return _printable(payload.decode("utf-8", "backslashreplace"), _SHOWN)


def numbers_in(payload: bytes) -> list[tuple[str, float]]:
    """The first numbers of a JSON document, with the pointers to them as people can read them; [] of anything else."""
    try:
        found = islice(numbers(_parsed(payload)), _NUMBERS)
        return [(_printable(pointer, _SHOWN), number) for pointer, number in found]
    except _Refusal:
        return []


def _printable(text: str, longest: int) -> str:
    printable = "".join(character if character.isprintable() else " " for character in text[: longest + 1])
    return printable if len(printable) <= longest else f"{printable[: longest - 3]}..."


def quality_word(value: object) -> str:
    """A quality as it is compared: text in lower case, numbers as they are written, true and false."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value).strip().lower()


def _text(payload: bytes) -> str:
    try:
        return payload.decode("utf-8-sig").strip()
    except UnicodeDecodeError:
        raise _Refusal(Fault.NON_NUMERIC, "is no UTF-8 text") from None


def _parsed(payload: bytes) -> Any:
    text = _text(payload)
    if not text:
        raise _Refusal(Fault.NOT_AVAILABLE, "is empty")
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        raise _Refusal(Fault.NON_NUMERIC, f"{shown(payload)!r} is not JSON") from None


def _number(value: object) -> float:
    """A number, a bool, or text that is one of these."""
    if isinstance(value, str):
        word = value.strip().lower()
        if word in _NOTHING:
            raise _Refusal(Fault.NOT_AVAILABLE, "says that there is no value")
        if word in _WORDS:
            return _WORDS[word]
        try:
            # Python would take digit separators; nobody else does.
            return float("" if "_" in word else word)
        except ValueError:
            raise _Refusal(Fault.NON_NUMERIC, f"{_printable(value, _SHOWN)!r} is not a number") from None
    if value is None:
        raise _Refusal(Fault.NOT_AVAILABLE, "says that there is no value")
    if not isinstance(value, int | float):
        raise _Refusal(Fault.NON_NUMERIC, f"has {'an object' if isinstance(value, dict) else 'a list'} for a number")
    try:
        return float(value)
    except OverflowError:
        raise _Refusal(Fault.NOT_FINITE, "has a number that no computer measures") from None


def _from_json(document: object, form: PayloadFormat, near: float) -> Decoded:
    value = resolve(document, form.value)
    if value is MISSING:
        raise _Refusal(Fault.NON_NUMERIC, f'has nothing at "{_pointer(form.value)}"; look at value')
    quality = _quality(document, form)
    time = MISSING if form.time is None else resolve(document, form.time)
    return Decoded(_number(value), None if time in (MISSING, None) else _time(time, form, near), False, quality)


def _time(value: object, form: PayloadFormat, near: float) -> float:
    try:
        return parse_time(value, form.time_format, form.zone, near)
    except NaiveTime as error:
        raise _Refusal(Fault.NAIVE_TIMESTAMP, str(error)) from None
    except ValueError as error:
        raise _Refusal(Fault.BAD_TIMESTAMP, str(error)) from None


def _quality(document: object, form: PayloadFormat) -> Quality:
    """The quality that `document` states; one that should be there and is not leaves the value uncertain."""
    if form.quality is None:
        return Quality.GOOD
    stated = resolve(document, form.quality)
    if stated is MISSING or stated is None:
        return Quality.UNCERTAIN
    word = quality_word(stated)
    if word in form.good:
        return Quality.GOOD
    if word in form.uncertain:
        return Quality.UNCERTAIN
    raise _Refusal(
        Fault.REPORTED_BAD, f'says that its quality is "{word}", which is neither listed as good nor uncertain'
    )


def _records(document: object) -> Mapping[str, Sequence[senml.Record]]:
    found: dict[str, list[senml.Record]] = {}
    try:
        for record in senml.records(document):
            found.setdefault(record.name, []).append(record)
    except ValueError as error:
        raise _Refusal(Fault.NON_NUMERIC, str(error)) from None
    return found


def _from_senml(records: Mapping[str, Sequence[senml.Record]], form: PayloadFormat) -> Iterator[Decoded | Rejected]:
    if form.record is None and len(records) > 1:
        raise _Refusal(Fault.NON_NUMERIC, f"has several records; give record, one of {_some(records)}")
    meant = next(iter(records.values()), ()) if form.record is None else records.get(form.record, ())
    if not meant:
        raise _Refusal(Fault.NOT_AVAILABLE, f'has no record "{form.record}"; it has {_some(records) or "none"}')
    for record in meant:
        try:
            yield _from_record(record, form)
        except _Refusal as refusal:
            yield refusal.rejected


def _some(records: Iterable[str]) -> str:
    return ", ".join(islice(records, 8))


def _from_record(record: senml.Record, form: PayloadFormat) -> Decoded:
    if record.text:
        raise _Refusal(Fault.NON_NUMERIC, f'has a record "{record.name}" whose value is not a number')
    if form.unit is not None and record.unit not in (None, form.unit):
        raise _Refusal(Fault.WRONG_UNIT, f'has "{record.name}" in {record.unit}, and the channel says {form.unit}')
    if record.time is not None and not isfinite(record.time):
        raise _Refusal(Fault.BAD_TIMESTAMP, "has a time that is not finite")
    quality = _quality(record.fields, form)
    relative = record.time is not None and record.time < senml.ABSOLUTE_FROM
    return Decoded(_number(record.value), record.time, relative, quality)


def _pointer(tokens: tuple[str, ...]) -> str:
    return "".join(f"/{write(token)}" for token in tokens)
