"""Values and names as a sentence shows them."""

import difflib
import re
from collections.abc import Iterable, Sequence


def shown(value: object) -> str:
    """`value` as the writer of the file knows it."""
    if isinstance(value, str):
        return f'"{_without_secrets(value)}"'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list | tuple):
        return f"[{', '.join(shown(item) for item in value)}]" if len(value) < 6 else "a list"
    return str(value)


_PASSWORD = re.compile(r"(?i)(?<=/)([^/@\s:]*):[^@\s]*@|\b(password|passwd|secret|token)\s*([=:])\s*[^;&#,\s]+")
_LONGEST = 200


def _without_secrets(text: str) -> str:
    """`text` without what may be a secret in the wrong place: the content of a file, passwords, keys of ours."""
    if "-----BEGIN" in text:
        return "-----BEGIN ..."
    text = re.sub(r"\btg_[\w-]{20,}", "tg_...", text)
    text = _PASSWORD.sub(lambda found: f"{found[1]}:...@" if found[1] is not None else f"{found[2]}{found[3]}...", text)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def printable(text: str, longest: int = _LONGEST) -> str:
    """What somebody else wrote, for people: on one line, and of `longest` characters at most."""
    line = "".join(character if character.isprintable() else " " for character in text[: longest + 1])
    return line if len(line) <= longest else f"{line[: longest - 3]}..."


def listed(names: Sequence[str], most: int) -> str:
    """`names`, of many the first `most` and how many more there are."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def suggestion(wrong: object, right: Iterable[str], what: str) -> str:
    """How to go on after an unknown name: the right ones, and the closest of them."""
    names = list(right)
    close = difflib.get_close_matches(str(wrong), names, n=1, cutoff=0.7)
    meant = f'; did you mean "{close[0]}"?' if close else ""
    return f"{what} {', '.join(names) or 'none'}{meant}"
