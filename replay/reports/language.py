"""A report in another language: everything it says, found by its English in the files of that language.

`report-<language>.json` has what reports say, and the page's `said-<language>.json` what the daemon says. An entry is
a sentence with {gaps} for numbers and names; a gap in capitals holds other such sentences, one with a capital
a part of one, and {{ is a brace. What is not found, and names, stay as they are.
"""

import json
import re
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import cache
from importlib.resources import files

from replay.reports.kit.report import Plot, Report, Section
from replay.reports.kit.table import Cell, Table, shown

LANGUAGES = ("en", "de")
"""What a report can be in; the first is what it is written in."""

Say = Callable[[str], str]

_DURATION = re.compile(r"(?<![^\s(])(\d+)(min|[dhs])(?![^\s,.;:)])")
_DECIMAL = r"(?<![\w./])(\d+)\.(\d+(?:e[+-]?\d+)?)(?![\w/]|\.\d)"
_GAP = re.compile(r"\{\{|\}\}|\{(\w+)\}")


def sayer(language: str, names: Collection[str] = ()) -> Say:
    """What gives a sentence in `language`, one of LANGUAGES; `names`, of zones, channels and parameters, stay as they
    are."""
    if language == LANGUAGES[0]:
        return lambda text: text if text in names else _spaced(text)
    kept = map(re.escape, sorted((name for name in names if "." in name), key=len, reverse=True))
    numbers = re.compile("|".join(["`[^`]*`", *kept, _DECIMAL]))

    def say(text: str) -> str:
        told = text if text in names else _said(language, text) or _spaced(text)
        return numbers.sub(lambda found: found[0] if found[1] is None else f"{found[1]},{found[2]}", told)

    return say


def _spaced(text: str) -> str:
    """`text` with lengths of time, which the daemon writes as a configuration does, as people write them."""
    return _DURATION.sub(lambda found: "24 h" if found[0] == "1d" else f"{found[1]} {found[2]}", text)


def in_language(report: Report, language: str, names: Collection[str]) -> Report:
    """`report` in `language`; `names` as for `sayer`."""
    say = sayer(language, names)
    return report._replace(
        title=say(report.title),
        lead=tuple(map(say, report.lead)),
        sections=tuple(_section(section, say) for section in report.sections),
        language=language,
    )


def table_in(table: Table, say: Say) -> Table:
    """`table` with what `say` makes of its title, head, words and note."""
    rows = tuple(tuple(_cell(cell, say) for cell in row) for row in table.rows)
    return replace(
        table, title=say(table.title), columns=tuple(map(say, table.columns)), rows=rows, note=say(table.note)
    )


def _cell(cell: Cell, say: Say) -> Cell:
    return say(shown(cell)) if isinstance(cell, str | float) else cell


def _section(section: Section, say: Say) -> Section:
    return section._replace(
        title=say(section.title),
        paragraphs=tuple(map(say, section.paragraphs)),
        tables=tuple(table_in(table, say) for table in section.tables),
        plots=tuple(_plot(plot, say) for plot in section.plots),
    )


def _plot(plot: Plot, say: Say) -> Plot:
    return plot._replace(title=say(plot.title), reading=say(plot.reading), chart=plot.chart._replace(say=say))


def _said(language: str, text: str) -> str | None:
    """`text` in `language`; None where it is not in the files."""
    # Titles, and sentences that begin with a capital, are entries that do not.
    lower = text[:1].lower() + text[1:]
    for pattern, translated in _entries(language):
        for written in dict.fromkeys((text, lower)):
            if (match := pattern.fullmatch(written)) is not None:
                values = {name: _value(language, name, value) for name, value in match.groupdict().items()}
                found = translated.format(**values)
                return found if written is text else found[:1].upper() + found[1:]
    first, parts, rest = text.partition("; ")
    start, end = (_said(language, part) for part in (first, rest)) if parts else (None, None)
    return f"{start or first}; {end or rest}" if start or end else None


def _value(language: str, name: str, value: str) -> str:
    return (_said(language, value) if name[0].isupper() else None) or _spaced(value)


@cache
def _entries(language: str) -> tuple[tuple[re.Pattern[str], str], ...]:
    """All entries of `language`, those that say more first."""
    texts: dict[str, str] = {}
    for package, name in (
        ("service.web", f"static/said-{language}.json"),
        ("replay.reports", f"report-{language}.json"),
    ):
        texts |= json.loads(files(package).joinpath(name).read_text(encoding="utf-8"))
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
