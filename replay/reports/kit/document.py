"""The words of a report as a Markdown file beside the code that has its figures.

`# ` is the title, and `## ` begins a section, whose paragraphs are parted by blank lines. `{name}` is a value. A
paragraph that begins with `[[name]]` is the place of the table of that name: the rest of its line is the table's title,
and the lines below are its note.
"""

from __future__ import annotations

import re
from dataclasses import replace
from importlib.resources import files

from replay.reports.kit.report import Section
from replay.reports.kit.table import Table

_TABLE = re.compile(r"\[\[(.+?)\]\] (.*)")


class Document:
    """The file `report.md` of a package."""

    def __init__(self, package: str, name: str = "report.md") -> None:
        text = files(package).joinpath(name).read_text(encoding="utf-8")
        first, *rest = text.removeprefix("# ").split("\n## ")
        self.title = first.strip()
        self._sections = dict(part.partition("\n")[::2] for part in rest)

    def section(self, heading: str, *tables: Table | None, **values: object) -> Section:
        """The section of that heading, filled with `values` and `tables`; what is empty then, or None, is left out."""
        given = {table.name: table for table in tables if table is not None}
        paragraphs, shown = [], []
        for block in self._sections[heading].split("\n\n"):
            head, *below = block.strip().split("\n")
            place = _TABLE.fullmatch(head.format(**values)) if head.startswith("[[") else None
            note = " ".join(below).format(**values)
            if place is None:
                paragraphs.append(" ".join([head.format(**values), note]).strip())
            elif place[1] in given:
                shown.append(replace(given.pop(place[1]), title=place[2], note=note))
        assert not given, f"{heading} has no place for {', '.join(given)}"
        return Section(heading.format(**values), tuple(filter(None, paragraphs)), tuple(shown))

    def lines(self, heading: str, **values: object) -> tuple[str, ...]:
        """The paragraphs of that section alone."""
        return self.section(heading, **values).paragraphs
