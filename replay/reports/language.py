"""A report in another language: what the daemon says, and by `report-<language>.json` what only reports say."""

from collections.abc import Collection
from dataclasses import replace

from replay.reports.kit.report import Plot, Report, Section
from replay.reports.kit.table import Cell, Table, shown
from service.publish import language as spoken
from service.publish.language import Catalogue, Say

REPORTED: Catalogue = ("replay.reports", "report-{language}.json")


def sayer(language: str, names: Collection[str] = ()) -> Say:
    """As that of what the daemon says, and knows what reports say as well."""
    return spoken.sayer(language, names, REPORTED)


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
