"""Charts as SVG without a library, which stretches with the page; labels are text beside it and keep their size."""

import math
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from html import escape
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.finding import amount
from replay.scores.windows import runs

_DAY = 86_400
_STEPS = (*(3600 * hours for hours in (1, 3, 6, 12)), *(_DAY * days for days in (1, 2, 7, 14)))
"""s between two marks of an axis of times; beyond these it has the first of months."""
_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_WIDE, _HIGH = 2000, 1000
"""Units of a panel: a screen hardly has more pixels."""
_MARKS, _LEVELS, _FEW = 10, 4, 3
"""Marks along a chart at most, about so many up, and powers of ten that are too few to be all."""


class Line(NamedTuple):
    """A line through (K,) points, which ends where `y` is NaN; with `step` each value holds until the next."""

    name: str
    colour: str
    """A class of report.css, as everywhere here."""
    x: Array
    y: Array
    step: bool = False
    dashed: bool = False


class Band(NamedTuple):
    """The area between two lines, with gaps where either is NaN."""

    name: str
    x: Array
    lower: Array
    upper: Array


class Bars(NamedTuple):
    """Bars of `width` around `x`, from `base` upwards by `y`; all (K,)."""

    name: str
    colour: str
    x: Array
    y: Array
    width: float
    base: Array


class Level(NamedTuple):
    y: float


Mark = Line | Band | Bars | Level


class Panel(NamedTuple):
    """One pair of axes, `height` pixels high."""

    marks: Sequence[Mark]
    unit: str = ""
    height: int = 280
    range: tuple[float, float] | None = None
    """What is shown; None: everything."""
    log: bool = False
    title: str = ""


class Chart(NamedTuple):
    """Panels over the same axis, in so many columns; `axis` says what it is."""

    panels: Sequence[Panel]
    axis: str
    dated: bool = False
    """Whether the axis has seconds of a wall clock."""
    columns: int = 1
    labels: Sequence[tuple[float, str]] = ()
    """Marks of the axis; without them there are some of its own."""
    say: Callable[[str], str] = str
    """What gives every text in the reader's language."""

    def html(self, title: str) -> str:
        spans = [_span(np.concatenate([_x(mark) for mark in panel.marks])) for panel in self.panels]
        x = (min(low for low, _ in spans), max(high for _, high in spans))
        marks = list(self.labels) or _dates(*x) if self.dated else list(self.labels) or _numbers(*x, _MARKS)
        keys = "".join(f"<li><i class='{kind}'></i>{self._said(name)}</li>" for name, kind in self.names.items())
        below = "".join(
            f"<span style='left:{_share(at, x)}%'>{self._said(text)}</span>" for at, text in marks if x[0] <= at <= x[1]
        )
        shown = [self._panel(panel, x, [at for at, _ in marks], below, title) for panel in self.panels]
        years = "–".join(dict.fromkeys(f", {_date(at).year}" for at in x)).replace("–, ", "–") if self.dated else ""
        axis = f"{self._said(self.axis)}{years}"
        return (
            f"<ul class='keys'>{keys}</ul><div class='chart' style='--columns:{self.columns}' data-x='{x[0]} {x[1]}'"
            f"{' data-dated' if self.dated else ''}>{''.join(shown)}</div><p class='axis'>{axis}<output></output></p>"
        )

    @property
    def names(self) -> dict[str, str]:
        named: dict[str, str] = {}
        for mark in (mark for panel in self.panels for mark in panel.marks):
            if isinstance(mark, Line) and mark.name:
                named.setdefault(mark.name, f"{mark.colour}{' dashed' * mark.dashed}")
            elif isinstance(mark, Bars) and mark.name:
                named.setdefault(mark.name, f"{mark.colour} area")
            elif isinstance(mark, Band):
                named.setdefault(mark.name, "band area")
        return named

    def _said(self, text: str) -> str:
        return escape(self.say(text))

    def _panel(self, panel: Panel, x: tuple[float, float], across: Sequence[float], below: str, title: str) -> str:
        values = np.concatenate([_y(mark) for mark in panel.marks])
        y = panel.range or _span(values[values > 0.0] if panel.log else values, 0.0 if panel.log else 0.05)
        levels = _decades(*y) if panel.log else _numbers(*y, _LEVELS)
        if panel.log:
            y = (math.log10(y[0]), math.log10(y[1]))
            levels = [(math.log10(at), text) for at, text in levels]
        place = _Place(x, y, panel.log)
        grid = "".join(f"M{place.x(at)} 0V{_HIGH}" for at in across if x[0] < at < x[1])
        grid += "".join(f"M0 {place.y(at)}H{_WIDE}" for at, _ in levels)
        texts = "".join(f"<span style='bottom:{_share(at, y)}%'>{self._said(text)}</span>" for at, text in levels)
        drawn = "".join(place.drawn(mark) for mark in panel.marks)
        name = self._said(panel.title)
        ends = f"data-y='{y[0]} {y[1]}'{' data-log' if panel.log else ''}"
        box = (
            f"viewBox='0 0 {_WIDE} {_HIGH}' preserveAspectRatio='none' role='img' aria-label='{name or escape(title)}'"
        )
        return (
            f"<div class='panel'><p>{name} {self._said(panel.unit)}</p>"
            f"<div class='place' style='height:{panel.height}px' {ends}>"
            f"<div class='levels' aria-hidden='true'>{texts}</div>"
            f"<svg {box}><path class='grid' d='{grid}'/>{drawn}</svg></div>"
            f"<div class='below' aria-hidden='true'>{below}</div></div>"
        )


class _Place(NamedTuple):
    """Where things are in a panel; logarithms are taken of what comes along `y` with `log`."""

    across: tuple[float, float]
    up: tuple[float, float]
    log: bool

    def x(self, values: Array | float) -> Array:
        return self._units(values, self.across, _WIDE)

    def y(self, values: Array | float) -> Array:
        """Of values that are logarithms already where the panel has them."""
        # A wild value lies beyond the panel, but no further than numbers of a path may.
        return _HIGH - np.clip(self._units(values, self.up, _HIGH), -_HIGH, 2 * _HIGH)

    def measured(self, values: Array) -> Array:
        """(K, 1) of the values of a mark."""
        if not self.log:
            return values
        with np.errstate(divide="ignore", invalid="ignore"):
            found: Array = np.log10(values)
        return found

    @staticmethod
    def _units(values: Array | float, span: tuple[float, float], size: int) -> Array:
        shares = (np.nan_to_num(values, nan=span[0], posinf=span[1], neginf=span[0]) - span[0]) / (span[1] - span[0])
        return np.rint(size * np.clip(shares, -9.0, 9.0)).astype(int)

    def drawn(self, mark: Mark) -> str:
        if isinstance(mark, Level):
            return f"<path class='level' d='M0 {self.y(float(self.measured(np.array(mark.y))))}H{_WIDE}'/>"
        if isinstance(mark, Line):
            kind = f"{mark.colour}{' dashed' * mark.dashed}"
            path = "".join(
                _path(self.x(mark.x[run]), self.y(self.measured(mark.y[run])), mark.step) for run in _known(mark.y)
            )
            return f"<path class='line {kind}' d='{path}'/>"
        if isinstance(mark, Band):
            path = ""
            for run in _known(mark.lower + mark.upper):
                x, lower, upper = (
                    self.x(mark.x[run]),
                    *(self.y(self.measured(e[run])) for e in (mark.lower, mark.upper)),
                )
                path += f"{_path(np.concatenate([x, x[::-1]]), np.concatenate([upper, lower[::-1]]))}z"
            return f"<path class='band' d='{path}'/>"
        half, top, base = mark.width / 2.0, mark.base + np.nan_to_num(mark.y), mark.base
        left, right = self.x(mark.x - half), self.x(mark.x + half)
        path = "".join(
            f"M{a} {d}V{c}H{b}V{d}z" for a, b, c, d in zip(left, right, self.y(top), self.y(base), strict=True)
        )
        return f"<path class='bars {mark.colour}' d='{path}'/>"


def _path(x: Array, y: Array, step: bool = False) -> str:
    """Lines from point to point, each told from the one before: most steps are small, and so is the file."""
    dx, dy = np.diff(x).tolist(), np.diff(y).tolist()
    parts = (f"h{a}v{b}" if step else f"l{a} {b}" for a, b in zip(dx, dy, strict=True) if a or b)
    # A single point is a line of no length, which shows as a dot.
    return f"M{x[0]} {y[0]}{''.join(parts) or 'h0'}"


def _known(values: Array) -> list[slice]:
    """Where neighbours are all known."""
    return [slice(*run) for run in runs(np.isfinite(values))]


def _x(mark: Mark) -> Array:
    if isinstance(mark, Level):
        return np.empty(0)
    if isinstance(mark, Bars):
        return np.concatenate([mark.x - mark.width / 2.0, mark.x + mark.width / 2.0])
    return np.asarray(mark.x, dtype=np.float64)


def _y(mark: Mark) -> Array:
    if isinstance(mark, Level):
        return np.array([mark.y])
    if isinstance(mark, Band):
        return np.concatenate([mark.lower, mark.upper])
    return np.concatenate([mark.base, mark.base + mark.y]) if isinstance(mark, Bars) else mark.y


def _span(values: Array, margin: float = 0.0) -> tuple[float, float]:
    """From the lowest to the highest of `values`, which is some way, and a share of it more on either side."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    if low == high:
        low, high = (low, high) if not margin else (low - 0.5, high + 0.5)
        high = high if high > low else low + 1.0
    return low - margin * (high - low), high + margin * (high - low)


def _share(at: float, span: tuple[float, float]) -> str:
    return f"{100.0 * (at - span[0]) / (span[1] - span[0]):.4g}"


def _numbers(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Round numbers from `low` to `high`, about `most` of them, as they are written."""
    rough = (high - low) / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(each * power for each in (1.0, 2.0, 5.0, 10.0) if each * power >= rough)
    places = max(0, -math.floor(math.log10(step) + 1e-9))
    counts = range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    return [(count * step, f"{count * step + 0.0:.{places}f}") for count in counts]


def _decades(low: float, high: float) -> list[tuple[float, str]]:
    """Powers of ten, and where there are few, also 2 and 5 times these."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    found: list[float] = []
    for factors in ((1.0,), (1.0, 2.0, 5.0)):
        if len(found) < _FEW:
            found = [at for power in powers for factor in factors if low <= (at := factor * 10.0**power) <= high]
    return [(at, amount(at)) for at in found or (low, high)]


def _date(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC)


def _dates(low: float, high: float) -> list[tuple[float, str]]:
    """Round times from `low` to `high`: hours, days, or the first of months."""
    step = next((each for each in _STEPS if (high - low) / each <= _MARKS), None)
    if step is not None:
        times = np.arange(math.ceil(low / step), math.floor(high / step) + 1) * float(step)
        return [(at, _written(at)) for at in times.tolist()]
    first, last = (12 * _date(at).year + _date(at).month - 1 for at in (low, high))
    every = math.ceil((last - first) / _MARKS)
    months = (datetime(month // 12, month % 12 + 1, 1, tzinfo=UTC) for month in range(first, last + 1, max(1, every)))
    return [(month.timestamp(), _written(month.timestamp())) for month in months]


def _written(at: float) -> str:
    when = _date(at)
    return f"{when.day} {_MONTHS[when.month - 1]}" if at % _DAY == 0.0 else f"{when:%H:%M}"
