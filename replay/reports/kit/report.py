"""A report: tables as CSV, and one HTML page that needs nothing beside itself."""

from collections.abc import Mapping
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from replay.errors import writing
from replay.reports.kit.chart import Chart
from replay.reports.kit.table import Table, inline


class Plot(NamedTuple):
    name: str
    chart: Chart
    title: str = ""
    reading: str = ""


class Section(NamedTuple):
    """A heading and what stands under it. In paragraphs `backticks` mark code; one begun by a fence is a block."""

    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    plots: tuple[Plot, ...] = ()


class Report(NamedTuple):
    """What an experiment has to say; `lead` are the sentences a hurried reader needs, `files` are written beside it."""

    title: str
    lead: tuple[str, ...]
    sections: tuple[Section, ...]
    files: Mapping[str, str] = {}
    language: str = "en"
    """Of its words, as HTML names it."""

    @property
    def tables(self) -> list[Table]:
        return [table for section in self.sections for table in section.tables]


def write_report(report: Report, out: Path) -> list[Path]:
    """Write `report.html`, its files, and every table as CSV into the folder `out`; their paths."""
    texts = {"report.html": page(report), **report.files}
    texts |= {f"{table.name}.csv": table.csv() for table in report.tables}
    with writing(out):
        for name, text in texts.items():
            (out / name).write_text(text, encoding="utf-8")
    return [out / name for name in texts]


def page(report: Report) -> str:
    lead = "".join(f"<li>{inline(sentence)}</li>" for sentence in report.lead)
    plots = any(section.plots for section in report.sections)
    style, reading = (files(__package__).joinpath(name).read_text("utf-8") for name in ("report.css", "report.js"))
    script = f"<script>{reading}</script>" if plots else ""
    return (
        f"<!doctype html><html lang='{report.language}'><head><meta charset='utf-8'>"
        f"<meta name='viewport' content='width=device-width, initial-scale=1'><title>{escape(report.title)}</title>"
        f"<style>{style}</style>{script}</head><body><main><h1>{escape(report.title)}</h1>"
        f"<div class='lead'><ul>{lead}</ul></div>{''.join(map(_section, report.sections))}</main></body></html>\n"
    )


def _section(section: Section) -> str:
    tables = [table.html() for table in section.tables]
    parts = [*map(_paragraph, section.paragraphs), *tables, *map(_plot, section.plots)]
    return f"<section><h2>{escape(section.title)}</h2>{''.join(parts)}</section>"


def _paragraph(text: str) -> str:
    if text.startswith("```"):
        return f"<pre>{escape(text.strip('`').strip())}</pre>"
    return f"<p>{inline(text)}</p>"


def _plot(plot: Plot) -> str:
    return (
        f"<figure class='plot'><figcaption>{escape(plot.title)}</figcaption>{plot.chart.html(plot.title)}"
        f"<p class='reading'>{inline(plot.reading)}</p></figure>"
    )
