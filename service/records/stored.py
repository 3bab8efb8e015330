"""Records as checkpoints hold them: lists of their values, in the order in which their constructors take them."""

import inspect
from collections.abc import Mapping
from dataclasses import is_dataclass
from functools import cache
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints


def stored(value: Any) -> Any:
    """`value` with a list in place of every record and named tuple in it."""
    if is_dataclass(value):
        return [stored(getattr(value, name)) for name in _fields(value.__class__)]
    if isinstance(value, tuple | list):
        return [stored(one) for one in value]
    return value


def named(kind: Any, value: Any) -> Any:
    """What `stored` gave of a `kind`, with the names of the fields in place of the lists of records."""
    origin, arguments = get_origin(kind), get_args(kind)
    if not isinstance(value, list | tuple):
        return value
    if isinstance(kind, type) and (is_dataclass(kind) or hasattr(kind, "_fields")):
        pairs = zip(_fields(kind).items(), value, strict=False)
        return {name: named(own, one) for (name, own), one in pairs}
    if origin is tuple:
        kinds = arguments[:1] * len(value) if arguments[-1] is ... else arguments
        return [named(own, one) for own, one in zip(kinds, value, strict=False)]
    if NoneType in arguments:
        return named(next(one for one in arguments if one is not NoneType), value)
    return value


@cache
def _fields(kind: Any) -> Mapping[str, Any]:
    """The types of the arguments of a constructor."""
    hints = get_type_hints(kind)
    return {name: hints[name] for name in inspect.signature(kind).parameters}
