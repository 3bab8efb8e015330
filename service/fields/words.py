"""Values and names as a sentence shows them."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def shown(value: object) -> str:
    """`value` as the writer of the file knows it."""
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list | tuple):
        return f"[{', '.join(shown(item) for item in value)}]" if len(value) < 6 else "a list"
    return str(value)


def suggestion(wrong: object, right: Iterable[str], what: str) -> str:
    """How to go on after an unknown name: the right ones, and the closest of them."""
    names = list(right)
    close = difflib.get_close_matches(str(wrong), names, n=1, cutoff=0.7)
    meant = f'; did you mean "{close[0]}"?' if close else ""
    return f"{what} {', '.join(names) or 'none'}{meant}"
