"""SenML packs in JSON (RFC 8428): base fields resolved into records."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, TypeVar

ABSOLUTE_FROM = 2.0**28
"""Times from here on are UTC s since 1970; below, s from now on (section 4.5.3)."""

# Symbols of the registry (RFC 8428 and 8798) that are written differently here; all others are written alike.
_UNITS = {"Cel": "degC", "/": "1", "%EL": "%"}

_VERSION = 10

Default = TypeVar("Default", str, "str | None")

LONGEST_NAME = 256
"""Characters of a base name and a name: they are joined in every record, so a long one costs its length each time."""


class Record(NamedTuple):
    """A record: `value` is a number or bool, or None, of another kind if `text`; `time` UTC s, or s from now on below
    ABSOLUTE_FROM; `unit` as Thermogate writes it; `fields` as they came."""

    name: str
    value: float | bool | None
    text: bool
    time: float | None
    unit: str | None
    fields: Mapping[str, Any]


def records(document: object) -> Iterator[Record]:
    """The records of a pack, an array of objects or a single one; ValueError for what is no such pack."""
    pack = [document] if isinstance(document, dict) else document
    if not isinstance(pack, list):
        raise ValueError("is no SenML pack, which is an array of records")
    base: dict[str, Any] = {}
    for fields in pack:
        if not isinstance(fields, dict):
            raise ValueError("has a record that is no object")
        unknown = [label for label in fields if label.endswith("_")]
        if unknown:
            raise ValueError(f'has the field "{unknown[0]}", which must be understood and is not')
        base |= {label: fields[label] for label in ("bn", "bt", "bu", "bv", "bver") if label in fields}
        if _number(base, "bver", _VERSION) > _VERSION:
            raise ValueError(f"is written in version {base['bver']:g} of SenML; {_VERSION} is the newest that is known")
        if fields.keys() & {"n", "v", "vb", "vs", "vd", "s"} or "bn" not in fields:
            yield _resolved(fields, base)


def _resolved(fields: Mapping[str, Any], base: Mapping[str, Any]) -> Record:
    base_name, own_name = _text(base, "bn", ""), _text(fields, "n", "")
    if len(base_name) + len(own_name) > LONGEST_NAME:
        raise ValueError(f"has a name of more than {LONGEST_NAME} characters")
    value = fields.get("v", fields.get("vb"))
    text = (value is not None and not isinstance(value, int | float)) or bool(fields.keys() & {"vs", "vd"})
    # A base value alone is a value; a null is none, whatever the base.
    if "bv" in base and not text and not fields.keys() & {"vb"} and fields.get("v", 0) is not None:
        value = _number(fields, "v", 0.0) + _number(base, "bv", 0.0)
    timed = "t" in fields or "bt" in base
    unit = _text(fields, "u", _text(base, "bu", None))
    return Record(
        base_name + own_name,
        None if text else value,
        text,
        _number(fields, "t", 0.0) + _number(base, "bt", 0.0) if timed else None,
        None if unit is None else _UNITS.get(unit, unit),
        fields,
    )


def _text(fields: Mapping[str, Any], label: str, default: Default) -> str | Default:
    value = fields.get(label, default)
    if value != default and not isinstance(value, str):
        raise ValueError(f'has a "{label}" that is no text')
    return value


def _number(fields: Mapping[str, Any], label: str, default: float) -> float:
    value = fields.get(label, default)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f'has a "{label}" that is no number')
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f'has a "{label}" that no computer measures') from None
