"""A report into the terminal and into a file."""

from collections.abc import Sequence
from pathlib import Path

from replay.errors import writing
from replay.recorded.trace import Trace
from replay.reports import tables
from replay.reports.kit.report import page
from replay.reports.language import in_language, sayer, table_in
from replay.reports.page import report
from service.publish.language import LANGUAGES

FILE = "report.html"


def publish_report(
    site: str, traces: Sequence[Trace], out: Path, progress: bool = False, language: str = LANGUAGES[0]
) -> int:
    """Print the table of `traces`, write `report.html` into the folder `out`, and print where it is; 0. All of it is in
    `language`, one of LANGUAGES.

    With `progress` a terminal shows how far it is. Raises ReplayError where the folder cannot be written.
    """
    path = out / FILE
    with writing(out):
        path.write_text(report_page(site, traces, language, progress), encoding="utf-8")
    say = sayer(language, _names(traces))
    table = table_in(tables.skill(traces), say)
    print("\n".join(["", *tables.terminal(table), "", say(f"report: {path}")]))
    return 0


def report_page(site: str, traces: Sequence[Trace], language: str = LANGUAGES[0], progress: bool = False) -> str:
    """The report of `traces` as one HTML page in `language`, one of LANGUAGES."""
    return page(in_language(report(site, traces, progress), language, _names(traces)))


def _names(traces: Sequence[Trace]) -> frozenset[str]:
    return frozenset(
        name
        for trace in traces
        for name in (
            trace.zone,
            trace.estimator,
            trace.network.name,
            *trace.network.channels,
            *(parameter.name for parameter in trace.network.parameters),
        )
    )
