"""A report into the terminal and into a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from replay.errors import ReplayError
from replay.experiments.report import page
from replay.recorded.trace import Trace
from replay.reports import tables
from replay.reports.page import report

FILE = "report.html"


def publish_report(site: str, traces: Sequence[Trace], out: Path, progress: bool = False) -> int:
    """Print the table of `traces`, write `report.html` into the folder `out`, and print where it is; 0.

    With `progress` a terminal shows how far it is. Raises ReplayError where the folder cannot be written.
    """
    path = out / FILE
    try:
        out.mkdir(parents=True, exist_ok=True)
        path.write_text(page(report(site, traces, progress)), encoding="utf-8")
    except OSError as error:
        raise ReplayError(f"--out {out}: cannot be written ({error.strerror}); choose another folder") from error
    print("\n".join(["", *tables.terminal(tables.skill(traces)), "", f"report: {path}"]))
    return 0
