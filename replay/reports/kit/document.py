"""The words of a report as a Markdown file: `# ` is the title, and `## ` begins a section, whose paragraphs are parted
by blank lines. `{name}` is a value. A paragraph that begins with `[[name]]` is the place of the table or plot of that
name: the rest of its line is the title, and the lines below are the note."""

import re
from dataclasses import replace
from importlib.resources import files

from replay.reports.kit.report import Plot, Section
from replay.reports.kit.table import Table

_PLACE = re.compile(r"\[\[(.+?)\]\] (.*)")
PARTED = "\f"
"""Between the paragraphs of one value."""


class Document:
    """The file `report.md` of a package."""

    def __init__(self, package: str, name: str = "report.md") -> None:
        text = files(package).joinpath(name).read_text(encoding="utf-8")
        first, *rest = text.removeprefix("# ").split("\n## ")
        self.title = first.strip()
        self._sections = dict(part.partition("\n")[::2] for part in rest)

    def section(self, heading: str, *shown: Table | Plot | None, **values: object) -> Section:
        """The section of that heading, with `values` and what is `shown`; what is empty then, or None, is left out."""
        given = {one.name: one for one in shown if one is not None}
        paragraphs: list[str] = []
        tables: list[Table] = []
        plots: list[Plot] = []
        for block in self._sections[heading].split("\n\n"):
            head, *below = block.strip().split("\n")
            place = _PLACE.fullmatch(head.format(**values)) if head.startswith("[[") else None
            note = " ".join(below).format(**values)
            if place is None:
                paragraphs += [text for text in " ".join([head.format(**values), note]).strip().split(PARTED) if text]
                continue
            one = given.pop(place[1], None)
            if isinstance(one, Plot):
                plots.append(one._replace(title=place[2], reading=note))
            elif one is not None:
                tables.append(replace(one, title=place[2], note=note))
        assert not given, f"{heading} has no place for {', '.join(given)}"
        return Section(heading.format(**values), tuple(paragraphs), tuple(tables), tuple(plots))

    def lines(self, heading: str, **values: object) -> tuple[str, ...]:
        return self.section(heading, **values).paragraphs
