"""The pictures of the page, as SVG.

Drawn with matplotlib, which writes SVG by itself; plotly, which the live page uses, needs a browser for a picture.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from replay.lab.measuring.bench.targets import Sections

_BLUE, _ORANGE = "#1f77b4", "#ff7f0e"


def draw(sections: Sections, folder: Path) -> dict[str, str]:
    """Write what can be drawn into `folder`; caption by file name. Nothing where matplotlib is not installed."""
    try:
        import matplotlib
    except ImportError:
        return {}
    matplotlib.use("svg")
    # The same figures give the same file.
    matplotlib.rcParams["svg.hashsalt"] = "thermogate"
    folder.mkdir(parents=True, exist_ok=True)
    pictures = {}
    if "particles" in sections.get("growth", {}):
        _growth(sections["growth"], folder / "performance-growth.svg")
        pictures["performance-growth.svg"] = "Time of an update over particles, and of a sweep over zones"
    if "stages" in sections.get("stages", {}):
        _stages(sections["stages"], folder / "performance-stages.svg")
        pictures["performance-stages.svg"] = "Where the time of one update goes"
    return pictures


def _growth(found: Mapping[str, Any], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.6), layout="constrained")
    for axes, key, label, what in zip(
        figure.subplots(1, 2), ("particles", "zones"), ("particles", "zones"), ("an update", "a sweep"), strict=True
    ):
        sizes = [row[key] for row in found[key]]
        times = [1e3 * row["median_s"] for row in found[key]]
        bounds = [[1e3 * row[f"{side}_quartile_s"] for row in found[key]] for side in ("lower", "upper")]
        errors = [
            [max(0.0, middle - low) for middle, low in zip(times, bounds[0], strict=True)],
            [max(0.0, high - middle) for middle, high in zip(times, bounds[1], strict=True)],
        ]
        axes.errorbar(sizes, times, yerr=errors, marker="o", color=_BLUE, label="measured, with quartiles")
        axes.plot(sizes, [times[-1] * size / sizes[-1] for size in sizes], "--", color=_ORANGE, label="linear")
        axes.set(xscale="log", yscale="log", xlabel=label, ylabel=f"ms for {what}")
        axes.grid(visible=True, which="major", alpha=0.3)
        axes.legend(frameon=False)
    figure.savefig(path, metadata={"Date": None})


def _stages(found: Mapping[str, Any], path: Path) -> None:
    from matplotlib.figure import Figure

    stages = dict(reversed(found["stages"].items()))
    figure = Figure(figsize=(9, 0.8 + 0.24 * len(stages)), layout="constrained")
    axes = figure.subplots()
    axes.barh(list(stages), [1e6 * one["s"] for one in stages.values()], color=_BLUE)
    axes.set(xlabel="us of one update, one thread")
    axes.grid(visible=True, axis="x", alpha=0.3)
    figure.savefig(path, metadata={"Date": None})
