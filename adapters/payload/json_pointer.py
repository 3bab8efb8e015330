"""JSON pointers (RFC 6901): where in a document a value stands."""

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

_INDEX = re.compile(r"0|[1-9][0-9]*")
_LONE_TILDE = re.compile(r"~(?![01])")

MISSING: Any = object()
"""What `resolve` gives where a document has nothing at the pointer."""


def parse(pointer: str) -> tuple[str, ...]:
    """The reference tokens of `pointer`; "" is the whole document. ValueError if it is no JSON pointer."""
    if pointer and not pointer.startswith("/"):
        raise ValueError(f'"{pointer}" is no JSON pointer; begin it with /, such as "/present/value"')
    if _LONE_TILDE.search(pointer):
        raise ValueError(f'"{pointer}" is no JSON pointer; write ~ as ~0, and / inside a name as ~1')
    return tuple(token.replace("~1", "/").replace("~0", "~") for token in pointer.split("/")[1:])


def resolve(document: object, tokens: Sequence[str]) -> Any:
    """What stands in `document` at `tokens`, or MISSING."""
    for token in tokens:
        if isinstance(document, dict) and token in document:
            document = document[token]
        elif isinstance(document, list) and _INDEX.fullmatch(token) and int(token) < len(document):
            document = document[int(token)]
        else:
            return MISSING
    return document


def numbers(document: object) -> Iterator[tuple[str, float]]:
    """Every number in `document`, with the pointer to it, in the order in which they are written."""
    # A list of its own and no recursion: a document may be nested as deep as its text is long.
    waiting: list[tuple[str, object]] = [("", document)]
    while waiting:
        place, found = waiting.pop()
        if isinstance(found, int | float) and not isinstance(found, bool):
            with suppress(OverflowError):
                yield place, float(found)
            continue
        inner: list[tuple[object, object]] = list(found.items()) if isinstance(found, dict) else []
        if isinstance(found, list):
            inner = list(enumerate(found))
        waiting += [(place + written([str(token)]), value) for token, value in reversed(inner)]


def written(tokens: Sequence[str]) -> str:
    return "".join("/" + token.replace("~", "~0").replace("/", "~1") for token in tokens)
