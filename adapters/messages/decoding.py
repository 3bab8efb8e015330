"""What a payload says: plain numbers, JSON documents and SenML packs as values with their time and quality. Pure."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from math import isfinite
from typing import Any, NamedTuple
from zoneinfo import ZoneInfo

from adapters.fields.numbers import float_in
from adapters.fields.words import printable
from adapters.messages.config import MessageChannelConfig, quality_word
from adapters.payload import senml
from adapters.payload.json_pointer import MISSING, numbers, resolve, written
from adapters.payload.objects import KeyTwice, distinct
from adapters.payload.times import NaiveTime, parse_time
from adapters.reading import Fault, Quality

_SHOWN = 60
_SENTENCE = 300
_NUMBERS = 8
_NOTHING = {"", "null", "none"}
_WORDS = {"true": 1.0, "false": 0.0}


class Decoded(NamedTuple):
    """A value at `time`, UTC s or, if `relative`, s from another time of the sample on; None without a time."""

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
        self.rejected = Rejected(fault, printable(sentence, _SENTENCE))


class Payload:
    """The bytes of a message, which are parsed once in every format, however many channels read them."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        self._parsed: dict[str, Any] = {}

    def parsed(self, form: str) -> Any:
        """What they are in a format: text, a document, or records by their names. Raises _Refusal, each time anew."""
        if form not in self._parsed:
            try:
                self._parsed[form] = _PARSERS[form](self)
            except _Refusal as refusal:
                self._parsed[form] = refusal.rejected
        found = self._parsed[form]
        if isinstance(found, Rejected):
            raise _Refusal(*found)
        return found


def decode(payload: Payload | bytes, form: MessageChannelConfig, near: float) -> list[Decoded | Rejected]:
    """What `payload`, which came at `near` (UTC s), says to a channel: one entry, of SenML one per record."""
    whole = Payload(payload) if isinstance(payload, bytes) else payload
    try:
        found = whole.parsed(str(form.format))
        if form.format == "plain":
            return [Decoded(_number(found))]
        return [_from_json(found, form, near)] if form.format == "json" else list(_from_senml(found, form))
    except _Refusal as refusal:
        return [refusal.rejected]


def shown(payload: bytes) -> str:
    return printable(payload.decode("utf-8", "backslashreplace"), _SHOWN)


def numbers_in(payload: bytes) -> list[tuple[str, float]]:
    """The first numbers of a JSON document, with the pointers to them as people can read them; [] of anything else."""
    try:
        found = islice(numbers(Payload(payload).parsed("json")), _NUMBERS)
        return [(printable(pointer, _SHOWN), number) for pointer, number in found]
    except _Refusal:
        return []


def _text(payload: Payload) -> str:
    try:
        return payload.content.decode("utf-8-sig").strip()
    except UnicodeDecodeError:
        raise _Refusal(Fault.NON_NUMERIC, "is no UTF-8 text") from None


def _document(payload: Payload) -> Any:
    text = payload.parsed("plain")
    if not text:
        raise _Refusal(Fault.NOT_AVAILABLE, "is empty")
    try:
        return json.loads(text, object_pairs_hook=distinct)
    except KeyTwice as error:
        raise _Refusal(Fault.NON_NUMERIC, str(error)) from None
    except (ValueError, RecursionError):
        raise _Refusal(Fault.NON_NUMERIC, f"{shown(payload.content)!r} is not JSON") from None


def _records(payload: Payload) -> Mapping[str, Sequence[senml.Record]]:
    document, found = payload.parsed("json"), dict[str, list[senml.Record]]()
    try:
        for record in senml.records(document):
            found.setdefault(record.name, []).append(record)
    except ValueError as error:
        raise _Refusal(Fault.NON_NUMERIC, str(error)) from None
    return found


_PARSERS: dict[str, Callable[[Payload], Any]] = {"plain": _text, "json": _document, "senml": _records}


def _number(value: object) -> float:
    """A number, a bool, or text that is one of these."""
    if isinstance(value, str):
        word = value.strip().lower()
        if word in _WORDS:
            return _WORDS[word]
        if word not in _NOTHING:
            try:
                return float_in(word)
            except ValueError:
                raise _Refusal(Fault.NON_NUMERIC, f"{printable(value, _SHOWN)!r} is not a number") from None
        value = None
    if value is None:
        raise _Refusal(Fault.NOT_AVAILABLE, "says that there is no value")
    if not isinstance(value, int | float):
        raise _Refusal(Fault.NON_NUMERIC, f"has {'an object' if isinstance(value, dict) else 'a list'} for a number")
    try:
        return float(value)
    except OverflowError:
        raise _Refusal(Fault.NOT_FINITE, "has a number that no computer measures") from None


def _from_json(document: object, form: MessageChannelConfig, near: float) -> Decoded:
    pointer = form.value or ()
    value = resolve(document, pointer)
    if value is MISSING:
        raise _Refusal(Fault.NON_NUMERIC, f'has nothing at "{written(pointer)}"; look at value')
    quality = _quality(document, form)
    time = MISSING if form.time is None else resolve(document, form.time)
    return Decoded(_number(value), None if time in (MISSING, None) else _time(time, form, near), False, quality)


def _time(value: object, form: MessageChannelConfig, near: float) -> float:
    zone = None if form.time_zone is None else ZoneInfo(form.time_zone)
    try:
        return parse_time(value, str(form.time_format), zone, near)
    except NaiveTime as error:
        raise _Refusal(Fault.NAIVE_TIMESTAMP, str(error)) from None
    except ValueError as error:
        raise _Refusal(Fault.BAD_TIMESTAMP, str(error)) from None


def _quality(document: object, form: MessageChannelConfig) -> Quality:
    """The quality that `document` states; one that should be there and is not leaves the value uncertain."""
    if form.quality is None:
        return Quality.GOOD
    stated = resolve(document, form.quality)
    if stated is MISSING or stated is None:
        return Quality.UNCERTAIN
    word = quality_word(stated)
    if word in (form.good or ()):
        return Quality.GOOD
    if word in (form.uncertain or ()):
        return Quality.UNCERTAIN
    raise _Refusal(
        Fault.REPORTED_BAD, f'says that its quality is "{word}", which is neither listed as good nor uncertain'
    )


def _from_senml(
    records: Mapping[str, Sequence[senml.Record]], form: MessageChannelConfig
) -> Iterator[Decoded | Rejected]:
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


def _from_record(record: senml.Record, form: MessageChannelConfig) -> Decoded:
    unit = form.stated_unit
    if record.text:
        raise _Refusal(Fault.NON_NUMERIC, f'has a record "{record.name}" whose value is not a number')
    if unit is not None and record.unit not in (None, unit):
        raise _Refusal(Fault.WRONG_UNIT, f'has "{record.name}" in {record.unit}, and the channel says {unit}')
    if record.time is not None and not isfinite(record.time):
        raise _Refusal(Fault.BAD_TIMESTAMP, "has a time that is not finite")
    relative = record.time is not None and record.time < senml.ABSOLUTE_FROM
    return Decoded(_number(record.value), record.time, relative, _quality(record.fields, form))
