"""Objects of JSON: a key that is there twice is read in one way by this program, and in another by that one."""

from collections import Counter
from collections.abc import Sequence
from typing import Any


class KeyTwice(ValueError):
    """A sentence that goes on from "the document"."""


def distinct(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """The object of `pairs`, as the hook of a parser; KeyTwice if a key is there twice."""
    found = dict(pairs)
    if len(found) < len(pairs):
        ((name, _),) = Counter(name for name, _ in pairs).most_common(1)
        raise KeyTwice(f"has the key {name[:60]!r} twice; give it once")
    return found
