"""What the daemon says, in another language: found by its English in the page's `said-<language>.json`.

An entry is a sentence with {gaps} for numbers and names; a gap in capitals holds other such sentences, one with a
capital a part of one, and {{ is a brace. What is not found, and names, stay as they are.
"""

import json
import re
from collections.abc import Callable, Collection
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

LANGUAGES = ("en", "de")
"""What sentences can be in; the first is what they are written in."""

Say = Callable[[str], str]
Catalogue = tuple[str, str]
"""A package, and the path in it of a file of sentences, with {language} for the language."""

SAID: Catalogue = ("service.web", "static/said-{language}.json")
_SENTENCES = ("sentence", "reason", "beaten", "what", "why")
"""Keys of documents whose values are sentences."""
_REMEMBERED = 2000
"""Sentences: a thousand rooms say much the same."""

_DECIMAL = r"(?<![\w./])(\d+)\.(\d+(?:e[+-]?\d+)?)(?![\w/]|\.\d)"
_GAP = re.compile(r"\{\{|\}\}|\{(\w+)\}")


def sayer(language: str, names: Collection[str] = (), *more: Catalogue) -> Say:
    """What gives a sentence in `language`, one of LANGUAGES; `names`, of zones, channels and parameters, stay as they
    are, and `more` sentences are known than the daemon's."""
    if language == LANGUAGES[0]:
        return str
    kept = map(re.escape, sorted((name for name in names if "." in name), key=len, reverse=True))
    numbers = re.compile("|".join(["`[^`]*`", *kept, _DECIMAL]))
    entries = _entries(language, SAID, *more)

    def say(text: str) -> str:
        told = text if text in names else _said(entries, text) or text
        return numbers.sub(lambda found: found[0] if found[1] is None else f"{found[1]},{found[2]}", told)

    return say


def told_in(language: str, document: bytes) -> bytes:
    """The JSON `document` with its sentences in `language`, one of LANGUAGES."""
    if language == LANGUAGES[0]:
        return document
    told = _in_all(json.loads(document), _remembering(language))
    return json.dumps(told, ensure_ascii=False, separators=(",", ":")).encode()


def _in_all(value: Any, say: Say) -> Any:
    if isinstance(value, list):
        return [_in_all(one, say) for one in value]
    if not isinstance(value, dict):
        return value
    return {
        key: say(one) if key in _SENTENCES and isinstance(one, str) else _in_all(one, say) for key, one in value.items()
    }


@cache
def _remembering(language: str) -> Say:
    return lru_cache(_REMEMBERED)(sayer(language))


_Entries = tuple[tuple[re.Pattern[str], str], ...]


def _said(entries: _Entries, text: str) -> str | None:
    """`text` by its entry; None where there is none."""
    # Titles, and sentences that begin with a capital, are entries that do not.
    lower = text[:1].lower() + text[1:]
    for pattern, translated in entries:
        for written in dict.fromkeys((text, lower)):
            if (match := pattern.fullmatch(written)) is not None:
                values = {name: _value(entries, name, value) for name, value in match.groupdict().items()}
                found = translated.format(**values)
                return found if written is text else found[:1].upper() + found[1:]
    first, parts, rest = text.partition("; ")
    start, end = (_said(entries, part) for part in (first, rest)) if parts else (None, None)
    return f"{start or first}; {end or rest}" if start or end else None


def _value(entries: _Entries, name: str, value: str) -> str:
    return (_said(entries, value) if name[0].isupper() else None) or value


@cache
def _entries(language: str, *catalogues: Catalogue) -> _Entries:
    """All entries of `catalogues`, those that say more first."""
    texts: dict[str, str] = {}
    for package, path in catalogues:
        texts |= json.loads(files(package).joinpath(path.format(language=language)).read_text(encoding="utf-8"))
    longest = sorted(texts, key=lambda english: -len(_GAP.sub("", english)))
    return tuple((_pattern(english), texts[english]) for english in longest)


def _pattern(english: str) -> re.Pattern[str]:
    parts, end = [], 0
    for gap in _GAP.finditer(english):
        parts.append(re.escape(english[end : gap.start()]))
        # "; " parts sentences: a number or a name does not reach beyond it.
        held = "." if gap[1] is None or gap[1].isupper() else "(?:(?!; ).)"
        parts.append(re.escape(gap[0][0]) if gap[1] is None else f"(?P<{gap[1]}>{held}+?)")
        end = gap.end()
    return re.compile("".join([*parts, re.escape(english[end:])]), re.DOTALL)
