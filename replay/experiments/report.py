"""An experiment's report: CSV and Markdown tables, and one HTML page that needs nothing beside itself."""

from __future__ import annotations

import re
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from plotly.offline import get_plotlyjs

from replay.errors import ReplayError
from replay.experiments.table import Table

_STYLE = """
:root { color-scheme: light; --ink: #1b2430; --soft: #5b6776; --line: #d9dfe6; --accent: #0b5c8a; }
body { font: 16px/1.55 system-ui, sans-serif; color: var(--ink); margin: 0 auto; max-width: 76rem;
  padding: 2rem 1.2rem; }
h1 { font-size: 1.7rem; line-height: 1.25; } h2 { font-size: 1.25rem; margin-top: 2.6rem; }
p, ul { max-width: 46rem; } code, pre { font: .9em ui-monospace, monospace; background: #f2f5f8; border-radius: 3px; }
code { padding: .1em .3em; } pre { padding: .8rem 1rem; overflow-x: auto; }
.lead { background: #eef5f9; border-left: 4px solid var(--accent); padding: .4rem 1.2rem; }
figure { margin: 1.4rem 0; } figcaption { font-weight: 600; margin-bottom: .4rem; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: .84rem; }
th, td { padding: .25rem .55rem; border-bottom: 1px solid var(--line); text-align: right; white-space: nowrap; }
th { color: var(--soft); font-weight: 600; border-bottom: 2px solid var(--line); white-space: normal;
  vertical-align: bottom; }
td.text, th:first-child { text-align: left; } .note, .reading { color: var(--soft); font-size: .92rem; }
.quoted td { color: var(--soft); font-style: italic; background: #f7f9fb; }
.met, .missed, .open { border-radius: 3px; padding: .1rem .5rem; font-weight: 600; }
.met { background: #dcf2e3; color: #14613a; } .missed { background: #fbe3df; color: #96281b; }
.open { background: #eceff2; color: var(--soft); }
"""

_DRAWING = """
addEventListener("DOMContentLoaded", () => {
  const draw = (place) => {
    watcher.unobserve(place);
    const data = place.querySelector("script");
    if (!data) return;
    data.remove();
    const figure = JSON.parse(data.textContent);
    Plotly.newPlot(place, figure.data, figure.layout, {displaylogo: false, responsive: true});
  };
  const watcher = new IntersectionObserver(
    (seen) => seen.filter((one) => one.isIntersecting).forEach((one) => draw(one.target)), {rootMargin: "600px"});
  const places = document.querySelectorAll(".plot");
  places.forEach((place) => watcher.observe(place));
  addEventListener("beforeprint", () => places.forEach(draw));
});
"""
"""Draws a plot when it comes near the window: a page of thirty zones opens at once, and prints whole."""


class Plot(NamedTuple):
    """A plotly figure with a title and a sentence on how to read it."""

    title: str
    figure: Any
    reading: str
    height: int = 380
    """Pixels."""


class Picture(NamedTuple):
    """An SVG element of our own with a title and a sentence on how to read it."""

    title: str
    svg: str
    reading: str


class Section(NamedTuple):
    """A heading and what stands under it. In paragraphs `backticks` mark code; one begun by a fence is a block."""

    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    plots: tuple[Plot, ...] = ()
    pictures: tuple[Picture, ...] = ()


class Report(NamedTuple):
    """What an experiment has to say; `lead` are the sentences a hurried reader needs, `files` are written beside it."""

    title: str
    lead: tuple[str, ...]
    sections: tuple[Section, ...]
    files: Mapping[str, str] = {}

    @property
    def tables(self) -> list[Table]:
        """Every table, in order."""
        return [table for section in self.sections for table in section.tables]


def write_report(report: Report, out: Path) -> list[Path]:
    """Write `report.html`, its files, and every table as CSV and Markdown into the folder `out`; their paths."""
    files = {"report.html": page(report), **report.files}
    for table in report.tables:
        files[f"{table.name}.csv"] = table.csv()
        files[f"{table.name}.md"] = table.markdown()
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            (out / name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ReplayError(f"--out {out}: cannot be written ({error.strerror}); choose another folder") from error
    return [out / name for name in files]


def page(report: Report) -> str:
    """The report as one HTML page, plotly.js and all."""
    lead = "".join(f"<li>{_inline(sentence)}</li>" for sentence in report.lead)
    plots = any(section.plots for section in report.sections)
    script = f"<script>{get_plotlyjs()}</script><script>{_DRAWING}</script>" if plots else ""
    return (
        f"<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        f"<meta name='viewport' content='width=device-width, initial-scale=1'><title>{escape(report.title)}</title>"
        f"<style>{_STYLE}</style>{script}</head><body><h1>{escape(report.title)}</h1>"
        f"<div class='lead'><ul>{lead}</ul></div>{''.join(map(_section, report.sections))}</body></html>\n"
    )


def _section(section: Section) -> str:
    parts = [f"<section><h2>{escape(section.title)}</h2>"]
    parts += [_paragraph(text) for text in section.paragraphs]
    parts += [table.html() for table in section.tables]
    parts += [_figure(one.title, one.svg, one.reading) for one in section.pictures]
    parts += [_plot(plot) for plot in section.plots]
    return "".join([*parts, "</section>"])


def _paragraph(text: str) -> str:
    if text.startswith("```"):
        return f"<pre>{escape(text.strip('`').strip())}</pre>"
    return f"<p>{_inline(text)}</p>"


def _plot(plot: Plot) -> str:
    figure = plot.figure.update_layout(
        template="plotly_white", margin={"l": 60, "r": 20, "t": 40, "b": 50}, height=plot.height
    )
    # In a script a "</" would end it, whatever a channel is called.
    drawn = figure.to_json().replace("</", "<\\/")
    data = f"<script type='application/json'>{drawn}</script>"
    return _figure(plot.title, f"<div class='plot' style='min-height:{plot.height}px'>{data}</div>", plot.reading)


def _figure(title: str, content: str, reading: str) -> str:
    caption, below = f"<figcaption>{escape(title)}</figcaption>", f"<p class='reading'>{_inline(reading)}</p>"
    return f"<figure>{caption}{content}{below}</figure>"


def _inline(text: str) -> str:
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text, quote=False))
