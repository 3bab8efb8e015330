"""Result tables, as CSV in full, and rounded as HTML."""

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import NamedTuple

import numpy as np


class Spread(NamedTuple):
    """A figure over several seeds: its mean and sample standard deviation (NaN for a single one)."""

    mean: float
    sd: float

    def __str__(self) -> str:
        text = number(self.mean)
        places = None if "e" in text else decimals(self.mean)
        return text if math.isnan(self.sd) else f"{text} ± {number(self.sd, places)}"


Cell = str | float | int | Spread | None
"""None: not known or not applicable."""


def spread(values: Sequence[float]) -> Spread:
    array = np.asarray(values, dtype=np.float64)
    return Spread(float(array.mean()), float(array.std(ddof=1)) if len(array) > 1 else math.nan)


@dataclass(frozen=True)
class Table:
    """Rows of cells under `columns`; `name` becomes the file's, `note` says what the reader must know beside it."""

    name: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    title: str = ""
    note: str = ""
    quoted: int = 0
    """How many rows at the end are published figures, not of this run."""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"table {self.name}: a row of {len(row)} cells under {len(self.columns)} columns")

    def csv(self) -> str:
        """Unrounded; a column with spreads is followed by one with their standard deviations."""
        spreads = [any(isinstance(row[i], Spread) for row in self.rows) for i in range(len(self.columns))]
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        header = [[name, f"{name} (sd)"] if wide else [name] for name, wide in zip(self.columns, spreads, strict=True)]
        writer.writerow([cell for cells in header for cell in cells])
        for row in self.rows:
            cells = [_in_full(cell, wide) for cell, wide in zip(row, spreads, strict=True)]
            writer.writerow([cell for pair in cells for cell in pair])
        return text.getvalue()

    def html(self) -> str:
        """A figure element; numbers align right, and so does what stands above them."""
        texts = [all(_is_text(row[place]) for row in self.rows) for place in range(len(self.columns))]
        head = "".join(
            f"<th{_TEXT if text else ''}>{escape(name)}</th>" for name, text in zip(self.columns, texts, strict=True)
        )
        own = len(self.rows) - self.quoted
        body = "".join(
            f"{'<tr>' if place < own else _QUOTED}{''.join(map(_html_cell, row))}</tr>"
            for place, row in enumerate(self.rows)
        )
        note = f"<p class='note'>{inline(self.note)}</p>" if self.note else ""
        return (
            f"<figure class='table'><figcaption>{escape(self.title)}</figcaption>"
            f"<div class='scroll' tabindex='0' role='group' aria-label='{escape(self.title)}'>"
            f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>{note}</figure>"
        )


def shown(cell: Cell) -> str:
    """A cell as a person reads it."""
    if cell is None:
        return "–"
    return number(cell) if isinstance(cell, float) else str(cell)


def number(value: float, places: int | None = None) -> str:
    """Three significant digits, or `places` decimals."""
    if math.isnan(value):
        return "–"
    if value != 0 and places is None and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.2e}"
    return f"{value:.{decimals(value) if places is None else places}f}"


def decimals(value: float) -> int:
    """Decimals that show three significant digits of `value`, but at least whole numbers."""
    if value == 0 or not math.isfinite(value):
        return 2
    return max(0, 2 - math.floor(math.log10(abs(value))))


def _in_full(cell: Cell, wide: bool) -> list[str]:
    if isinstance(cell, Spread):
        return [_exact(cell.mean), _exact(cell.sd)]
    text = "" if cell is None else _exact(cell) if isinstance(cell, float) else str(cell)
    return [text, ""] if wide else [text]


def _exact(value: float) -> str:
    return "" if math.isnan(value) else repr(float(value))


_QUOTED = "<tr class='quoted'>"
_TEXT = " class='text'"
_MARKS = ("met", "missed", "open")
_NUMBER = re.compile(r"[+-]?\d[\d.,]*(e[+-]?\d+)?( %)?|–")


def inline(text: str) -> str:
    """`text` as HTML, in which `backticks` mark code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text, quote=False))


def _is_text(cell: Cell) -> bool:
    return isinstance(cell, str) and not _NUMBER.fullmatch(cell)


def _html_cell(cell: Cell) -> str:
    text = inline(shown(cell))
    if cell in _MARKS:
        text = f"<span class='{cell}'>{text}</span>"
    return f"<td{_TEXT}>{text}</td>" if _is_text(cell) else f"<td>{text}</td>"
