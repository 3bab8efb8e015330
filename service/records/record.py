"""Records: frozen dataclasses that are their own JSON and schema, fields described by `shown`. What is not a finite
number is null; other numbers are written in full, so that reading one back gives the very same float64."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, make_dataclass
from datetime import datetime
from functools import cache
from operator import attrgetter
from typing import Annotated, Any, Literal, TypeVar, dataclass_transform, get_type_hints

import numpy as np
import numpy.typing as npt
from pydantic import PlainSerializer, TypeAdapter, WithJsonSchema
from pydantic_core import CoreSchema, core_schema

from adapters.fields.times import utc

Number = Annotated[float, WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "null"}]})]
"""A float64, null in JSON where it is not finite."""

_RFC_3339 = (
    PlainSerializer(utc, return_type=datetime, when_used="json"),
    WithJsonSchema({"type": "string", "format": "date-time"}),
)
Time = Annotated[int, *_RFC_3339]
"""Whole UTC s, RFC 3339 in JSON."""
Moment = Annotated[float, *_RFC_3339]
"""UTC s, RFC 3339 in JSON."""


class _Numbers:
    """An array in a record: lists of floats in JSON, as deep as it has axes."""

    def __init__(self, axes: int) -> None:
        self._axes = axes

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        listed: CoreSchema = core_schema.float_schema()
        for _ in range(self._axes):
            listed = core_schema.list_schema(listed)
        written = core_schema.plain_serializer_function_ser_schema(np.ndarray.tolist, return_schema=listed)
        return core_schema.any_schema(serialization=written)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: Any) -> dict[str, Any]:
        described: dict[str, Any] = {"anyOf": [{"type": "number"}, {"type": "null"}]}
        for _ in range(self._axes):
            described = {"items": described, "type": "array"}
        return described


Vector = Annotated[npt.NDArray[np.float64], _Numbers(1)]
Matrix = Annotated[npt.NDArray[np.float64], _Numbers(2)]
Matrices = Annotated[npt.NDArray[np.float64], _Numbers(3)]
"""Arrays of float64 with one, two and three axes; lists in JSON, null where not finite."""

Kind = TypeVar("Kind")


def shown(
    text: str = "",
    *,
    key: str | None = None,
    examples: Sequence[Any] | None = None,
    default: Any = MISSING,
    kw_only: bool = False,
) -> Any:
    """A field that JSON has: what it means, and its `key` there if that is not its name."""
    known = {"description": text or None, "serialization_alias": key, "examples": examples}
    metadata = {name: value for name, value in known.items() if value is not None}
    return field(default=default, kw_only=kw_only, metadata=metadata)


def constant(value: Any, text: str = "", *, init: Literal[False] = False) -> Any:
    """A field that is the same in every record, such as a unit."""
    return field(default=value, init=init, metadata={"description": text} if text else {})


def hidden(*, default: Any, kw_only: bool = False) -> Any:
    """A field that JSON does not have."""
    return field(default=default, kw_only=kw_only, metadata={"exclude": True})


@dataclass_transform(frozen_default=True, field_specifiers=(field, shown, constant, hidden))
def record(kind: type[Kind]) -> type[Kind]:
    """Decorator: `kind` is a record."""
    kind.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]
    made: Any = dataclass(frozen=True, slots=True)(kind)
    slots = [getattr(made, name) for name in names(made)]

    def set_state(one: Any, state: Iterable[Any]) -> None:
        for slot, value in zip(slots, state, strict=True):
            slot.__set__(one, value)

    # A fleet unpickles records all the time, and dataclasses look up their fields for each.
    made.__setstate__ = set_state
    return made


@cache
def names(kind: type) -> tuple[str, ...]:
    """The names of the fields of a record."""
    return tuple(one.name for one in fields(kind))


def values(one: Any) -> tuple[Any, ...]:
    """The values of the fields of a record, in their order."""
    return _getter(one.__class__)(one)


def to_json(one: Any) -> bytes:
    """A record as strict JSON, UTF-8."""
    return _adapter(one.__class__).dump_json(one, by_alias=True)


def document(one: Any, site: str, zone: str | None = None) -> bytes:
    """The JSON of a record as it leaves the daemon: with the version of its schema, the site and the zone before it."""
    about: dict[str, Any] = {"schema": 1, "site": site} | ({} if zone is None else {"zone": zone})
    head, body = json.dumps(about, separators=(",", ":"), ensure_ascii=False).encode(), to_json(one)
    return head[:-1] + b"," + body[1:]


def with_items(written: bytes, items: Iterable[bytes]) -> bytes:
    """The same of a record whose last field is an empty list, with `items` in it, each of them JSON: for lists that
    would take much memory, and the interpreter for long, in one piece."""
    return written.removesuffix(b"]}") + b",".join(items) + b"]}"


@cache
def document_of(kind: type, of_a_zone: bool = True, name: str = "") -> type:
    """The type of `document` of a record of `kind`, for the schema of an answer, which may have a `name` of its own."""
    about = fields(_OfAZone if of_a_zone else _OfTheSite)
    hints = get_type_hints(_OfAZone) | get_type_hints(kind, include_extras=True)
    described = [(one.name, hints[one.name], _like(one)) for one in (*about, *fields(kind))]
    space = {"__doc__": kind.__doc__, "__module__": kind.__module__, "__pydantic_config__": {"extra": "forbid"}}
    return make_dataclass(name or kind.__name__, described, namespace=space)


def enclosed(one: Any, site: str, zone: str) -> Any:
    """What `document` writes, as a record to be part of another one."""
    return document_of(one.__class__)(site=site, zone=zone, **dict(zip(names(one.__class__), values(one), strict=True)))


@record
class _OfTheSite:
    schema: Literal[1] = constant(1, "version of this payload's schema")
    site: str = shown(examples=["htwg"])


@record
class _OfAZone(_OfTheSite):
    zone: str = shown(examples=["living"])


def _like(one: Field[Any]) -> Any:
    """The field in a document, which always has it: only what is constant keeps its value."""
    return field(default=MISSING if one.init else one.default, metadata=one.metadata, kw_only=True)


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


@cache
def _getter(kind: Any) -> attrgetter[tuple[Any, ...]]:
    return attrgetter(*names(kind))
