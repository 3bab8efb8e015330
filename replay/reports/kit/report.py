"""An experiment's report: CSV and Markdown tables, and one HTML page that needs nothing beside itself."""

from __future__ import annotations

import re
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from plotly.offline import get_plotlyjs

from replay.errors import ReplayError
from replay.reports.kit.table import Table

_STYLE = """
:root { color-scheme: light dark; --paper: #fff; --ink: #1b2430; --soft: #5b6776; --line: #d9dfe6;
  --accent: #0b5c8a; --code: #f2f5f8; --lead: #eef5f9; --quoted: #f7f9fb; --met: #14613a; --met-back: #dcf2e3;
  --missed: #96281b; --missed-back: #fbe3df; --open-back: #eceff2; }
@media screen and (prefers-color-scheme: dark) { :root { --paper: #14171a; --ink: #e4e7ea; --soft: #98a2ad;
  --line: #2f353b; --accent: #6fb1ea; --code: #23282d; --lead: #1c2730; --quoted: #1b1f23; --met: #7fd6a3;
  --met-back: #173524; --missed: #f2958d; --missed-back: #40201d; --open-back: #2a2f35; } }
body { font: 16px/1.55 system-ui, sans-serif; color: var(--ink); background: var(--paper); margin: 0 auto;
  max-width: 76rem; padding: 2rem 1.2rem; }
h1 { font-size: 1.7rem; line-height: 1.25; } h2 { font-size: 1.25rem; margin-top: 2.6rem; }
p, ul { max-width: 46rem; }
code, pre { font: .9em ui-monospace, monospace; background: var(--code); border-radius: 3px; }
code { padding: .1em .3em; } pre { padding: .8rem 1rem; overflow-x: auto; }
.lead { background: var(--lead); border-left: 4px solid var(--accent); padding: .4rem 1.2rem; }
figure { margin: 1.4rem 0; } figcaption { font-weight: 600; margin-bottom: .4rem; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: .84rem; }
th, td { padding: .25rem .55rem; border-bottom: 1px solid var(--line); text-align: right; white-space: nowrap; }
th { color: var(--soft); font-weight: 600; border-bottom: 2px solid var(--line); white-space: normal;
  vertical-align: bottom; }
td.text, th:first-child { text-align: left; } .note, .reading { color: var(--soft); font-size: .92rem; }
.quoted td { color: var(--soft); font-style: italic; background: var(--quoted); }
.met, .missed, .open { border-radius: 3px; padding: .1rem .5rem; font-weight: 600; }
.met { background: var(--met-back); color: var(--met); }
.missed { background: var(--missed-back); color: var(--missed); }
.open { background: var(--open-back); color: var(--soft); }
"""

_DRAWING = """
addEventListener("DOMContentLoaded", () => {
  const dark = matchMedia("screen and (prefers-color-scheme: dark)");
  const figures = new Map();
  const lighter = {"#1b2430": "#e4e7ea", "#0b5c8a": "#6fb1ea", "rgba(11,92,138,.22)": "rgba(111,177,234,.25)",
    "#c2571a": "#f09a5e", "#5b6776": "#98a2ad", "#2e7d4f": "#6cc48f", "#3d8b4f": "#6cc48f", "#8a3b8f": "#d08fd6",
    "#a8841a": "#dcb84e", "#b3324b": "#f0849a", "#1f9aa0": "#5fd0d6"};
  const recoloured = (value, key) => {
    if (typeof value === "string") return lighter[value] ?? value;
    if (!value || typeof value !== "object" || key === "x" || key === "y") return value;
    if (Array.isArray(value)) return value.map((one) => recoloured(one));
    return Object.fromEntries(Object.entries(value).map(([name, one]) => [name, recoloured(one, name)]));
  };
  const draw = (place, night) => {
    watcher.unobserve(place);
    const data = place.querySelector("script");
    if (data) {
      data.remove();
      figures.set(place, data.textContent);
    }
    if (!figures.has(place)) return;
    const figure = JSON.parse(figures.get(place));
    const shown = night ? recoloured(figure) : figure;
    if (night) {
      const template = shown.layout.template.layout;
      const lines = {gridcolor: "#2f353b", linecolor: "#2f353b", zerolinecolor: "#4a525a"};
      Object.assign(template, {paper_bgcolor: "#14171a", plot_bgcolor: "#14171a", font: {color: "#c3cad1"}});
      Object.assign(template.xaxis, lines);
      Object.assign(template.yaxis, lines);
    }
    Plotly.react(place, shown.data, shown.layout, {displaylogo: false, responsive: true});
  };
  const watcher = new IntersectionObserver(
    (seen) => seen.filter((one) => one.isIntersecting).forEach((one) => draw(one.target, dark.matches)),
    {rootMargin: "600px"});
  const places = document.querySelectorAll(".plot");
  places.forEach((place) => watcher.observe(place));
  const redraw = () => [...figures.keys()].forEach((place) => draw(place, dark.matches));
  dark.addEventListener("change", redraw);
  addEventListener("beforeprint", () => places.forEach((place) => draw(place, false)));
  addEventListener("afterprint", redraw);
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
        f"<!doctype html><html lang='{report.language}'><head><meta charset='utf-8'>"
        f"<meta name='viewport' content='width=device-width, initial-scale=1'><title>{escape(report.title)}</title>"
        f"<style>{_STYLE}</style>{script}</head><body><h1>{escape(report.title)}</h1>"
        f"<div class='lead'><ul>{lead}</ul></div>{''.join(map(_section, report.sections))}</body></html>\n"
    )


def _section(section: Section) -> str:
    parts = [f"<section><h2>{escape(section.title)}</h2>"]
    parts += [_paragraph(text) for text in section.paragraphs]
    parts += [table.html() for table in section.tables]
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
