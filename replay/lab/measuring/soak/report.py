"""A soak as lines, as a page with its curves, and as a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from replay.lab.measuring.soak.observation import Observation
from replay.lab.measuring.soak.verdict import Verdict

CURVES = {
    "resident_mb": "resident memory, MB",
    "descriptors": "file descriptors",
    "threads": "threads",
    "disk_mb": "state_dir, MB",
    "samples": "samples in the journal",
    "streams": "open streams",
}


def lines(result: Mapping[str, Any], verdicts: Sequence[Verdict]) -> list[str]:
    """For a terminal."""
    last, company = result["last"], result["company"]
    return [
        f"{result['simulated_hours']:.0f} simulated hours in {result['real_seconds']:.0f} s, {result['zones']} zones; "
        f"{last['samples']} samples accepted, {last['overruns']:.0f} overruns",
        f"company: {company['opened']} streams, {company['events']} events on them, {company['heard']} messages on "
        f"Zenoh, {company['requests']} requests ({company['not_answered']} without an answer), "
        f"{company['faults']} faults, {company['reloads']} reloads",
        *(
            f"{one.limit.figure}: {one.slope:+.3f} {one.limit.unit} per {one.limit.by} "
            f"(95 %: {one.lower:+.3f} to {one.upper:+.3f}; limit {one.limit.most:g}) "
            f"{'within' if one.within else 'EXCEEDED'}"
            for one in verdicts
        ),
        f"memory {result['after_warm_up']['resident_mb']:.0f} MB after the warm-up, {last['resident_mb']:.0f} MB at "
        f"the end; {100 * result['late_timers_share']:.2f} % of the timers more than 20 ms late; "
        f"{result['cores_used']:.2f} cores; stopped in {result['stop_s']:.1f} s",
    ]


def write_page(path: Path, observations: Sequence[Observation], pace: float, text: Sequence[str]) -> None:
    """The curves over simulated hours, self-contained."""
    figure = make_subplots(rows=3, cols=2, shared_xaxes=True, subplot_titles=list(CURVES.values()))
    hours = [one.elapsed * pace / 3600.0 for one in observations]
    for index, name in enumerate(CURVES):
        values = [getattr(one, name) for one in observations]
        figure.add_trace(go.Scatter(x=hours, y=values, name=name), row=index // 2 + 1, col=index % 2 + 1)
    figure.update_xaxes(title_text="simulated hours", row=3)
    figure.update_layout(height=900, showlegend=False, title_text="<br>".join(text), title_font_size=12)
    figure.update_layout(margin_t=60 + 20 * len(text))
    figure.write_html(path, include_plotlyjs=True)


def draw(path: Path, observations: Sequence[Observation], pace: float) -> bool:
    """The same curves as SVG, if matplotlib is there; whether it is."""
    try:
        import matplotlib
    except ImportError:
        return False
    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "thermogate"
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 6.5), layout="constrained")
    hours = [one.elapsed * pace / 3600.0 for one in observations]
    for axes, (name, label) in zip(figure.subplots(3, 2, sharex=True).flat, CURVES.items(), strict=True):
        axes.plot(hours, [getattr(one, name) for one in observations], linewidth=0.8)
        axes.set_title(label, fontsize=9)
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
    for axes in figure.axes[-2:]:
        axes.set_xlabel("simulated hours")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})
    return True
